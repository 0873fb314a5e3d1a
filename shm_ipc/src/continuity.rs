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
    counting: u64,
    produced: u64,
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
        let FrameHeader { epoch, counting, produced, .. } = *header;
        match self.last.replace(Position { epoch, counting, produced }) {
            // Before the first frame, the consumer was not there.
            None => Step { lost: 0, epoch_changed: false },
            Some(last) => {
                // Counted anew: all that came before this frame, the least that it can be.
                let known = if counting == last.counting { last.produced } else { 0 };
                let lost = produced.saturating_sub(known).saturating_sub(1);
                Step { lost, epoch_changed: (counting, epoch) != (last.counting, last.epoch) }
            }
        }
    }
}

#[cfg(test)]
#[path = "continuity/tests.rs"]
mod tests;
