//! How much a consumer lost, told from the headers that reached it.

use crate::header::FrameHeader;

/// Follows the frames that reach one consumer.
#[derive(Debug, Default)]
pub(crate) struct Continuity {
    last: Option<Position>,
}

#[derive(Debug, Clone, Copy)]
struct Position {
    epoch: u64,
    sequence: u64,
    lost_in_epoch: u64,
}

/// What lies between one frame and the frame before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Step {
    /// Frames that the device produced and this consumer did not get.
    pub lost: u64,
    /// Whether the frame belongs to another stream than the frame before. The first frame ever has none before it.
    pub epoch_changed: bool,
}

impl Continuity {
    /// Takes the next frame into account, in the order of arrival.
    ///
    /// Saturates where a header lies: nothing is known of such a stream.
    pub(crate) fn step(&mut self, header: &FrameHeader) -> Step {
        let FrameHeader { epoch, sequence, lost_in_epoch, .. } = *header;
        let last = self.last.replace(Position { epoch, sequence, lost_in_epoch });
        match last {
            // Before the first frame, the consumer was not there.
            None => Step { lost: 0, epoch_changed: false },
            Some(last) if last.epoch == epoch => {
                let overflowed = sequence.saturating_sub(last.sequence.saturating_add(1));
                let unpublished = lost_in_epoch.saturating_sub(last.lost_in_epoch);
                Step { lost: overflowed.saturating_add(unpublished), epoch_changed: false }
            }
            // All of the new stream that came before this frame.
            Some(_) => Step { lost: sequence.saturating_add(lost_in_epoch), epoch_changed: true },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(continuity: &mut Continuity, epoch: u64, sequence: u64, lost_in_epoch: u64) -> (u64, bool) {
        let header = FrameHeader { epoch, sequence, lost_in_epoch, ..FrameHeader::default() };
        let step = continuity.step(&header);
        (step.lost, step.epoch_changed)
    }

    #[test]
    fn frames_before_the_first_are_nobodys_loss() {
        assert_eq!(step(&mut Continuity::default(), 7, 1000, 12), (0, false));
    }

    #[test]
    fn overflow_and_unpublished_frames_add_up() {
        let mut continuity = Continuity::default();
        step(&mut continuity, 7, 0, 0);
        assert_eq!(step(&mut continuity, 7, 1, 0), (0, false));
        assert_eq!(step(&mut continuity, 7, 2, 3), (3, false), "3 never published");
        assert_eq!(step(&mut continuity, 7, 5, 3), (2, false), "2 overflowed");
        assert_eq!(step(&mut continuity, 7, 7, 5), (3, false), "1 overflowed; 2 never published, around it");
    }

    #[test]
    fn a_new_epoch_counts_from_its_start() {
        let mut continuity = Continuity::default();
        step(&mut continuity, 7, 500, 20);
        assert_eq!(step(&mut continuity, 8, 0, 0), (0, true));
        assert_eq!(step(&mut continuity, 9, 2, 1), (3, true));
        assert_eq!(step(&mut continuity, 9, 3, 1), (0, false));
    }

    #[test]
    fn nonsense_saturates() {
        let mut continuity = Continuity::default();
        step(&mut continuity, 7, u64::MAX, u64::MAX);
        assert_eq!(step(&mut continuity, 7, 0, 0), (0, false));
        assert_eq!(step(&mut continuity, 7, u64::MAX, u64::MAX), (u64::MAX, false));
    }
}
