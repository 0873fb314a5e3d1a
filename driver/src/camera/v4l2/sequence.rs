//! Frame counts from the sequence numbers of the kernel.

/// Turns the sequence numbers of V4L2 buffers into a count that only grows. They have 32 bits and wrap to 0.
#[derive(Debug, Default)]
pub(super) struct SequenceUnwrapper {
    last: Option<(u32, u64)>,
}

impl SequenceUnwrapper {
    /// The count of the frame with this sequence number: 0 for the first frame, then one more for every frame that the device
    /// produced. A driver that does not count, or began anew, tells nothing about frames in between.
    pub(super) fn unwrap(&mut self, sequence: u32) -> u64 {
        let count = match self.last {
            None => 0,
            Some((last, count)) => match sequence.wrapping_sub(last) {
                0 | 0x8000_0000.. => count + 1,
                step => count + u64::from(step),
            },
        };
        self.last = Some((sequence, count));
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence_counts<const N: usize>(sequence: [u32; N]) -> [u64; N] {
        let mut unwrapper = SequenceUnwrapper::default();
        sequence.map(|number| unwrapper.unwrap(number))
    }

    #[test]
    fn sequence_numbers_count_gaps_across_their_wrap() {
        assert_eq!(sequence_counts([5, 6, 9]), [0, 1, 4]);
        assert_eq!(sequence_counts([u32::MAX - 1, u32::MAX, 0, 1]), [0, 1, 2, 3]);
        assert_eq!(sequence_counts([u32::MAX, 2]), [0, 3]);
        assert_eq!(sequence_counts([0, i32::MAX as u32]), [0, i32::MAX as u64]);
    }

    #[test]
    fn sequence_numbers_that_stand_still_or_fall_back_count_one_frame() {
        assert_eq!(sequence_counts([0, 0, 0]), [0, 1, 2]);
        assert_eq!(sequence_counts([100, 101, 0, 1]), [0, 1, 2, 3]);
    }
}
