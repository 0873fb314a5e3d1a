//! What a device produced, counted across epochs and drivers: the driver's side of every consumer's loss.

/// A number from here on is nonsense: no clock and no camera comes this far.
const NONSENSE: u64 = 1 << 63;

/// How far a camera has come. A driver keeps it in the page of the wake word, from where its successor goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Production {
    /// Identity of the counting: another one where `produced` began anew.
    pub(crate) counting: u64,
    /// Frames that the device produced since the counting began, published or not.
    pub(crate) produced: u64,
    /// The last epoch that was begun.
    pub(crate) epoch: u64,
}

impl Production {
    /// Goes on from what the driver before left behind, at `now_ns` of CLOCK_REALTIME; counts anew where that is nothing, or nonsense.
    pub(crate) fn resume(left_behind: Option<Production>, now_ns: u64) -> Self {
        left_behind.filter(Production::is_sane).unwrap_or(Production {
            counting: now_ns.max(1),
            produced: 0,
            epoch: 0,
        })
    }

    /// Another process wrote it.
    fn is_sane(&self) -> bool {
        self.counting != 0 && self.produced < NONSENSE && self.epoch < NONSENSE
    }

    /// As it is `frames` frames later.
    #[inline]
    pub(crate) fn after(self, frames: u64) -> Self {
        Production { produced: self.produced.saturating_add(frames), ..self }
    }

    /// As it is when another epoch begins, at `now_ns` of CLOCK_REALTIME: a clock that was set back repeats none.
    pub(crate) fn in_next_epoch(self, now_ns: u64) -> Self {
        Production { epoch: now_ns.max(self.epoch.saturating_add(1)), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: u64 = 1_700_000_000_000_000_000;

    #[test]
    fn epochs_rise_whatever_the_clock_does() {
        let first = Production::resume(None, NOW_NS).in_next_epoch(NOW_NS);
        assert_eq!(first.epoch, NOW_NS);
        assert_eq!(first.in_next_epoch(NOW_NS + 5).epoch, NOW_NS + 5);
        // The same instant, set back by an hour, and without a battery.
        for now_ns in [NOW_NS, NOW_NS - 3_600_000_000_000, 0] {
            assert_eq!(first.in_next_epoch(now_ns).epoch, NOW_NS + 1);
        }
        let successor = Production::resume(Some(first), 0);
        assert_eq!(successor.in_next_epoch(0).epoch, NOW_NS + 1, "also in the driver that comes after");
    }

    #[test]
    fn a_successor_goes_on() {
        let left_behind = Production::resume(None, NOW_NS).after(7);
        assert_eq!(Production::resume(Some(left_behind), NOW_NS + 1), left_behind);
    }

    #[test]
    fn where_nothing_sane_was_left_behind_counting_begins_anew() {
        let sane = Production { counting: 1, produced: 7, epoch: NOW_NS };
        let nonsense = [
            Production { counting: 0, ..sane },
            Production { produced: u64::MAX, ..sane },
            Production { epoch: u64::MAX, ..sane },
        ];
        for left_behind in nonsense.map(Some).into_iter().chain([None]) {
            let anew = Production::resume(left_behind, NOW_NS);
            assert_eq!(anew, Production { counting: NOW_NS, produced: 0, epoch: 0 }, "{left_behind:?}");
        }
    }
}
