//! What lies in the page, and the protocol of those who use it.
//!
//! This file is built twice: over the [`system`](super::system), and in `tests/loom.rs` over a model of it that tries every order in which
//! threads can run, and every value that the memory model lets them see.

use std::time::Duration;

use super::system::{AtomicU32, AtomicU64, Futex, Ordering, current_core};
use crate::header::CONTRACT_VERSION;
use crate::production::Production;

pub(super) const MAGIC: u32 = u32::from_le_bytes(*b"UVCW");
/// Somebody sleeps.
pub(super) const ASLEEP: u32 = 1;

/// The page, a cache line for each of three purposes. What follows them is zero.
#[derive(Debug, Default)]
#[repr(C)]
pub(crate) struct Page {
    pub(super) identity: Identity,
    pub(super) wake: Wake,
    pub(super) count: Count,
}

/// What it is: written once.
#[derive(Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Identity {
    pub(super) magic: AtomicU32,
    pub(super) contract_version: AtomicU32,
}

/// What consumers wait for: both numbers are written with each frame.
#[derive(Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Wake {
    pub(super) word: Futex,
    pub(super) core: AtomicU32,
}

/// A [`Production`], on a line that no consumer reads.
#[derive(Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct Count {
    pub(super) counting: AtomicU64,
    pub(super) produced: AtomicU64,
    pub(super) epoch: AtomicU64,
}

impl Page {
    /// The driver's side: makes the page one of this contract, or takes over that of the driver before, and wakes all who sleep: a driver
    /// that was killed between a frame's count and its wake-up has left them asleep.
    pub(super) fn take_over(&self) {
        if !self.is_ours() {
            // What another version kept there means something else, or nothing.
            self.keep(&Production { counting: 0, produced: 0, epoch: 0 });
        }
        self.identity.contract_version.store(u32::from(CONTRACT_VERSION), Ordering::Relaxed);
        // Release, paired with the Acquire in `is_ours`: who sees the magic sees the version.
        self.identity.magic.store(MAGIC, Ordering::Release);
        self.wake.word.wake_all();
    }

    /// Whether the page is finished, and of this contract.
    pub(super) fn is_ours(&self) -> bool {
        // Acquire, paired with the Release in `take_over`.
        self.identity.magic.load(Ordering::Acquire) == MAGIC
            && self.identity.contract_version.load(Ordering::Relaxed) == u32::from(CONTRACT_VERSION)
    }

    /// What [`Page::keep`] writes to.
    pub(crate) fn kept_in(&self) -> *const Count {
        &raw const self.count
    }

    /// The driver's side: keeps how far the camera has come for whoever drives it next.
    #[inline]
    pub(crate) fn keep(&self, production: &Production) {
        // Relaxed: read by a driver that finds this one gone.
        self.count.produced.store(production.produced, Ordering::Relaxed);
        self.count.epoch.store(production.epoch, Ordering::Relaxed);
        // Release, paired with the Acquire in `kept`: in a new page, what is counted is there before its identity, wherever the driver is
        // killed.
        self.count.counting.store(production.counting, Ordering::Release);
    }

    /// The driver's side: how far the camera has come, as the driver before kept it; `None` where there was none.
    pub(crate) fn kept(&self) -> Option<Production> {
        // Acquire, paired with the Release in `keep`.
        let counting = self.count.counting.load(Ordering::Acquire);
        let [produced, epoch] =
            [&self.count.produced, &self.count.epoch].map(|number| number.load(Ordering::Relaxed));
        (counting != 0).then_some(Production { counting, produced, epoch })
    }

    /// The driver's side: a frame was sent. Wakes whoever sleeps.
    pub(crate) fn announce(&self) {
        if self.count_frame() {
            self.wake.word.wake_all();
        }
        // Relaxed: advice that orders nothing.
        self.wake.core.store(current_core().map_or(0, |core| core.saturating_add(1)), Ordering::Relaxed);
    }

    /// Counts a frame, and returns whether somebody sleeps.
    pub(super) fn count_frame(&self) -> bool {
        let word = &self.wake.word;
        let next = (word.load(Ordering::Relaxed) | ASLEEP).wrapping_add(1);
        // Release, paired with the Acquire in `frames`: who sees the count sees the frame.
        word.swap(next, Ordering::AcqRel) & ASLEEP != 0
    }

    /// Frames announced so far, up to wrap-around: to be read before a look for a frame.
    pub(crate) fn frames(&self) -> u32 {
        // Acquire, paired with the Release in `count_frame`.
        self.wake.word.load(Ordering::Acquire) & !ASLEEP
    }

    /// Sleeps until a frame is announced after `seen` of [`Page::frames`], at most `timeout`. May return early. Returns whether all of the
    /// time passed.
    pub(crate) fn sleep(&self, seen: u32, timeout: Duration) -> bool {
        self.wake.word.wait(self.say_asleep(seen), timeout)
    }

    /// Says that somebody sleeps, and returns what the word then is.
    pub(super) fn say_asleep(&self, seen: u32) -> u32 {
        let asleep = seen | ASLEEP;
        // Fails where a frame was sent, and where another consumer said it before: the wait compares the word again, and tells these apart.
        // Relaxed, as it orders nothing.
        let _ = self.wake.word.compare_exchange(seen, asleep, Ordering::Relaxed, Ordering::Relaxed);
        asleep
    }

    /// The core that the driver last sent from, where it says so.
    pub(crate) fn core(&self) -> Option<u32> {
        // Relaxed: advice that orders nothing.
        self.wake.core.load(Ordering::Relaxed).checked_sub(1)
    }
}
