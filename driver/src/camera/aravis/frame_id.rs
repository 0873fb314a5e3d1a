//! Frame counts from the ids of devices, which can wrap around.

/// Turns the ids that a device sends into a count that only grows.
///
/// GigE Vision numbers frames with 16 bits, from 65535 on to 1 (0 is reserved); its extended ids and those of USB3 Vision have
/// 64 bits and do not wrap. A device does not say which it uses, nor need it: an id can only fall where 16 bits wrapped.
/// A gap of 65535 frames or more cannot be told from a shorter one on a 16-bit device.
#[derive(Debug, Default)]
pub(super) struct FrameIdUnwrapper {
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    id: u64,
    count: u64,
}

/// Ids that a 16-bit counter without 0 can take.
const WRAP: u64 = 65535;

impl FrameIdUnwrapper {
    /// The count of the frame with the device's id `id`: 0 for the first frame, then one more for every frame that the device
    /// produced. A device that repeats an id does not count; its frames then follow one another without a gap.
    pub(super) fn unwrap(&mut self, id: u64) -> u64 {
        let count = match self.last {
            None => 0,
            Some(last) => last.count + step(last.id, id),
        };
        self.last = Some(Last { id, count });
        count
    }
}

fn step(last: u64, id: u64) -> u64 {
    if id > last {
        return id - last;
    }
    if id < last && last <= WRAP {
        // From `last` to 65535, then from 1 to `id`.
        return (WRAP - last + id).max(1);
    }
    // The same id again, or a 64-bit counter that was reset: nothing is known about frames in between.
    1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(ids: impl IntoIterator<Item = u64>) -> Vec<u64> {
        let mut unwrapper = FrameIdUnwrapper::default();
        ids.into_iter().map(|id| unwrapper.unwrap(id)).collect()
    }

    #[test]
    fn counts_from_the_first_frame_on() {
        assert_eq!(counts([1, 2, 3]), [0, 1, 2]);
        assert_eq!(counts([0, 1, 2]), [0, 1, 2]);
        assert_eq!(counts([40_000, 40_001]), [0, 1]);
    }

    #[test]
    fn a_gap_is_counted() {
        assert_eq!(counts([7, 8, 12]), [0, 1, 5]);
    }

    #[test]
    fn sixteen_bits_wrap_to_one() {
        assert_eq!(counts([65534, 65535, 1, 2]), [0, 1, 2, 3]);
    }

    #[test]
    fn a_gap_across_the_wrap_is_counted() {
        // 65534, (65535, 1, 2 lost), 3
        assert_eq!(counts([65533, 65534, 3]), [0, 1, 5]);
    }

    #[test]
    fn a_device_that_uses_zero_still_grows() {
        assert_eq!(counts([65535, 0, 1]), [0, 1, 2]);
    }

    #[test]
    fn extended_ids_pass_sixteen_bits_without_a_wrap() {
        assert_eq!(counts([65535, 65536, 65538]), [0, 1, 3]);
    }

    #[test]
    fn long_ids_do_not_overflow() {
        assert_eq!(counts([u64::MAX - 1, u64::MAX, 1]), [0, 1, 2]);
        assert_eq!(counts([0, u64::MAX]), [0, u64::MAX]);
    }

    #[test]
    fn a_device_that_does_not_count_has_no_gaps() {
        assert_eq!(counts([0, 0, 0]), [0, 1, 2]);
    }

    #[test]
    fn every_id_of_two_turns_grows_by_one() {
        let ids = (1..=65535).chain(1..=65535);
        assert!(counts(ids).into_iter().eq(0..2 * 65535));
    }
}
