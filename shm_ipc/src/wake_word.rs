//! The wake word: how a driver wakes consumers that only wait for a frame, in about half of the time that an event takes.
//!
//! One page of shared memory for each camera, `/dev/shm/<prefix><camera>.<device>-<inode>.wake`, which the driver makes with its publisher;
//! device and inode are those of `root_path`, hexadecimal. It stays when the driver stops or is killed, as it also keeps how far the camera
//! has come, from where the next driver goes on. Part of the contract, little-endian:
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..4 | "UVCW" |
//! | 4..8 | [`CONTRACT_VERSION`] |
//! | 64..68 | the wake word, a futex (futex(2)) that processes share |
//! | 68..72 | the core that the driver last sent from, counted from 1; 0 where it does not say |
//! | 128..136 | `counting` of the last frame; 0 where nothing was counted yet |
//! | 136..144 | `produced`, with the lost frames that no frame has told of yet |
//! | 144..152 | the last epoch |
//!
//! Bit 0 of the word says that somebody sleeps; the other bits count frames and wrap.
//!
//! * After a frame is sent, the driver exchanges the word for the next count with bit 0 cleared, and wakes all sleepers where bit 0 was
//!   set. Nobody asleep means no system call.
//! * A consumer reads the word, looks for a frame, sets bit 0 where it finds none, and sleeps as long as the word is what it made it. A
//!   frame sent in between changes the word, so that no wake-up is missed.
//! * Count and bit are one word: whoever dies, at whatever point, leaves nothing behind that the next frame does not clear. A driver
//!   that starts takes over the page of the one before, sleepers included.
//! * A consumer watches for a frame on another core than the driver's only: there it would keep the driver from sending it.
//! * A sleep ends after 100 ms at the latest, for a look at whether driver and page are still the right ones.
//!
//! Laws of its memory:
//! 1. The mapping covers the whole page and lives as long as the [`WakeWord`]; the page is checked to have its size before it is used, and
//!    nobody makes it smaller: driver and consumers run under one user.
//! 2. The page is reached through atomics alone, as other processes write to it.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::num::NonZeroU64;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::{
    CpuSet, current_timer_slack, futex, sched_getaffinity, sched_getcpu, sched_setaffinity,
    set_current_timer_slack,
};

use crate::header::CONTRACT_VERSION;
use crate::production::Production;

const MAGIC: u32 = u32::from_le_bytes(*b"UVCW");
const PAGE_BYTES: usize = 4096;
/// Where the word lies, in units of four bytes: on a cache line of its own.
const WORD: usize = 16;
/// Where the driver's core lies, beside it: both are written with each frame.
const CORE: usize = 17;
/// Where the three numbers of a [`Production`] lie, in units of eight bytes: on a cache line that no consumer reads.
const COUNTING: usize = 16;
const PRODUCED: usize = 17;
const EPOCH: usize = 18;
/// Somebody sleeps.
const ASLEEP: u32 = 1;

/// The wake word of one camera.
#[derive(Debug)]
pub(crate) struct WakeWord {
    page: NonNull<AtomicU32>,
    path: PathBuf,
    /// Device and inode of the file: a name can lead elsewhere later.
    file: (u64, u64),
}

// SAFETY: law 2: any number of threads and processes may use the page at the same time.
unsafe impl Send for WakeWord {}
// SAFETY: law 2, as above.
unsafe impl Sync for WakeWord {}

impl WakeWord {
    /// The driver's side: makes the page, or takes over the one of the driver before.
    pub(crate) fn create(path: &Path) -> io::Result<WakeWord> {
        let file = options().create(true).mode(0o600).truncate(false).open(path)?;
        // Taken now: to write to a page that a full /dev/shm does not have ends a process with SIGBUS.
        fallocate(&file, FallocateFlags::empty(), 0, PAGE_BYTES as u64)?;
        let word = WakeWord::map(&file, path)?;
        if !word.is_ours() {
            // What another version kept there means something else, or nothing.
            word.keep(&Production { counting: 0, produced: 0, epoch: 0 });
        }
        word.at(1).store(u32::from(CONTRACT_VERSION), Ordering::Relaxed);
        // Release, paired with the Acquire in `open`: who sees the magic sees the version.
        word.at(0).store(MAGIC, Ordering::Release);
        Ok(word)
    }

    /// A consumer's side; `None` where there is no page, or one that is not finished or not of this contract.
    pub(crate) fn open(path: &Path) -> io::Result<Option<WakeWord>> {
        let file = match options().open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        if file.metadata()?.len() != PAGE_BYTES as u64 {
            return Ok(None);
        }
        let word = WakeWord::map(&file, path)?;
        Ok(word.is_ours().then_some(word))
    }

    /// Whether the page is finished, and of this contract.
    fn is_ours(&self) -> bool {
        // Acquire, paired with the Release in `create`.
        self.at(0).load(Ordering::Acquire) == MAGIC
            && self.at(1).load(Ordering::Relaxed) == u32::from(CONTRACT_VERSION)
    }

    fn map(file: &File, path: &Path) -> io::Result<WakeWord> {
        let found = file.metadata()?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping, at an address of the kernel's choice, touches no other memory.
        let page = unsafe { mmap(ptr::null_mut(), PAGE_BYTES, access, MapFlags::SHARED, file, 0) }?;
        let page = NonNull::new(page.cast()).ok_or(io::ErrorKind::AddrNotAvailable)?;
        Ok(WakeWord { page, path: path.to_owned(), file: (found.dev(), found.ino()) })
    }

    fn at(&self, place: usize) -> &AtomicU32 {
        debug_assert!(place < PAGE_BYTES / size_of::<AtomicU32>());
        // SAFETY: laws 1 and 2; every place used here lies in the page.
        unsafe { self.page.add(place).as_ref() }
    }

    fn wide_at(&self, place: usize) -> &AtomicU64 {
        debug_assert!(place < PAGE_BYTES / size_of::<AtomicU64>());
        // SAFETY: laws 1 and 2; every place used here lies in the page, whose start is aligned for any number.
        unsafe { self.page.cast::<AtomicU64>().add(place).as_ref() }
    }

    /// The driver's side: keeps how far the camera has come for whoever drives it next.
    #[inline]
    pub(crate) fn keep(&self, production: &Production) {
        // Relaxed: read by a driver that finds this one gone.
        self.wide_at(PRODUCED).store(production.produced, Ordering::Relaxed);
        self.wide_at(EPOCH).store(production.epoch, Ordering::Relaxed);
        // Release: in a new page, what is counted is there before its identity, wherever the driver is killed.
        self.wide_at(COUNTING).store(production.counting, Ordering::Release);
    }

    /// The driver's side, when it ends: where the page was removed behind its back, keeps that in another one.
    pub(crate) fn keep_anew(&self, production: &Production) {
        let is_gone =
            fs::symlink_metadata(&self.path).is_err_and(|error| error.kind() == io::ErrorKind::NotFound);
        // Where it fails, counting begins anew.
        if is_gone && let Ok(another) = WakeWord::create(&self.path) {
            another.keep(production);
        }
    }

    /// The driver's side: how far the camera has come, as the driver before kept it; `None` where there was none.
    pub(crate) fn kept(&self) -> Option<Production> {
        // Acquire, paired with the Release in `keep`.
        let counting = self.wide_at(COUNTING).load(Ordering::Acquire);
        let [produced, epoch] = [PRODUCED, EPOCH].map(|place| self.wide_at(place).load(Ordering::Relaxed));
        (counting != 0).then_some(Production { counting, produced, epoch })
    }

    /// The driver's side: a frame was sent. Wakes whoever sleeps.
    pub(crate) fn announce(&self) {
        let word = self.at(WORD);
        let next = (word.load(Ordering::Relaxed) | ASLEEP).wrapping_add(1);
        // Release, paired with the Acquire in `frames`: who sees the count sees the frame.
        if word.swap(next, Ordering::AcqRel) & ASLEEP != 0 {
            // The frame is out. A consumer that cannot be woken finds it when its own sleep ends.
            let _ = futex::wake(word, futex::Flags::empty(), i32::MAX as u32);
        }
        // Relaxed: advice that orders nothing.
        self.at(CORE).store(u32::try_from(sched_getcpu() + 1).unwrap_or(0), Ordering::Relaxed);
    }

    /// Frames announced so far, up to wrap-around: to be read before a look for a frame.
    pub(crate) fn frames(&self) -> u32 {
        // Acquire, paired with the Release in `announce`.
        self.at(WORD).load(Ordering::Acquire) & !ASLEEP
    }

    /// Sleeps until a frame is announced after `seen` of [`WakeWord::frames`], at most `timeout`. May return early. Returns whether
    /// all of the time passed.
    pub(crate) fn sleep(&self, seen: u32, timeout: Duration) -> bool {
        let word = self.at(WORD);
        // Fails where a frame was sent, and where another consumer said it before: the kernel compares the word again, and tells these
        // apart. Relaxed, as it orders nothing.
        let _ = word.compare_exchange(seen, seen | ASLEEP, Ordering::Relaxed, Ordering::Relaxed);
        let Ok(timeout) = timeout.try_into() else { return false };
        let outcome = futex::wait(word, futex::Flags::empty(), seen | ASLEEP, Some(&timeout));
        outcome == Err(rustix::io::Errno::TIMEDOUT)
    }

    /// As [`WakeWord::sleep`], for a `timeout` that is to be met: without the 50 us that the system may add to it (PR_SET_TIMERSLACK,
    /// prctl(2)).
    pub(crate) fn sleep_exactly(&self, seen: u32, timeout: Duration) {
        let usual = current_timer_slack().ok().and_then(NonZeroU64::new);
        let _ = set_current_timer_slack(NonZeroU64::new(1));
        self.sleep(seen, timeout);
        // The thread is the consumer's.
        let _ = set_current_timer_slack(usual);
    }

    /// Keeps this thread from the core that the driver last sent from. `None` where that core is not known, or the only one that the
    /// thread may use.
    pub(crate) fn step_aside(&self) -> Option<Aside> {
        // Relaxed: advice that orders nothing.
        let core = (self.at(CORE).load(Ordering::Relaxed) as usize).checked_sub(1)?;
        // Another process wrote the number.
        if core >= CpuSet::MAX_CPU {
            return None;
        }
        let usual = sched_getaffinity(None).ok()?;
        let mut others = usual;
        others.unset(core);
        // Fails where there are no others.
        sched_setaffinity(None, &others).ok()?;
        Some(Aside { usual })
    }

    /// Whether its name still leads to this page: where it was removed, the next driver makes another one.
    pub(crate) fn is_current(&self) -> bool {
        fs::metadata(&self.path).is_ok_and(|found| (found.dev(), found.ino()) == self.file)
    }
}

/// How the page is opened: never through a link, which anybody can put into `/dev/shm`.
fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags(OFlags::NOFOLLOW.bits().cast_signed());
    options
}

impl Drop for WakeWord {
    fn drop(&mut self) {
        // SAFETY: law 1: the mapping is this value's own, and no reference outlives it.
        let _ = unsafe { munmap(self.page.as_ptr().cast(), PAGE_BYTES) };
    }
}

/// While it lives, this thread stays away from the driver's core.
#[must_use]
pub(crate) struct Aside {
    usual: CpuSet,
}

impl Drop for Aside {
    fn drop(&mut self) {
        // The thread is the consumer's.
        let _ = sched_setaffinity(None, &self.usual);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(20);

    fn page() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir_in("/dev/shm").unwrap();
        let path = folder.path().join("left.wake");
        (folder, path)
    }

    #[test]
    fn a_frame_before_the_sleep_is_not_missed() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        let consumer = WakeWord::open(&path).unwrap().unwrap();
        let seen = consumer.frames();
        driver.announce();
        assert!(!consumer.sleep(seen, LONG));
        assert_ne!(consumer.frames(), seen);
    }

    #[test]
    fn all_sleepers_wake() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        std::thread::scope(|scope| {
            let sleepers: Vec<_> = (0..6)
                .map(|_| {
                    let consumer = WakeWord::open(&path).unwrap().unwrap();
                    let seen = consumer.frames();
                    scope.spawn(move || while consumer.frames() == seen && !consumer.sleep(seen, LONG) {})
                })
                .collect();
            while driver.at(WORD).load(Ordering::Relaxed) & ASLEEP == 0 {
                std::thread::yield_now();
            }
            driver.announce();
            sleepers.into_iter().for_each(|sleeper| sleeper.join().unwrap());
        });
    }

    #[test]
    fn nobody_asleep_costs_no_wake_up_and_a_dead_sleeper_only_one() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        let word = || driver.at(WORD).load(Ordering::Relaxed);
        driver.announce();
        assert_eq!(word() & ASLEEP, 0);
        // As a consumer that dies asleep leaves it.
        assert!(driver.sleep(driver.frames(), Duration::from_millis(1)));
        assert_eq!(word() & ASLEEP, ASLEEP);
        let frames = driver.frames();
        driver.announce();
        assert_eq!(word(), frames + 2);
    }

    /// On a thread of its own, which runs on one core; gives that core and those that the test may use.
    fn on_one_core(test: impl FnOnce(usize, CpuSet) + Send) {
        std::thread::scope(|scope| {
            let on_it = || {
                let all = sched_getaffinity(None).unwrap();
                let core = sched_getcpu();
                let mut one = CpuSet::new();
                one.set(core);
                sched_setaffinity(None, &one).unwrap();
                test(core, all);
            };
            scope.spawn(on_it).join().unwrap();
        });
    }

    #[test]
    fn who_is_going_to_watch_leaves_the_drivers_core_and_may_come_back() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        on_one_core(|core, all| {
            assert!(all.count() > 1, "needs two cores");
            driver.announce();
            sched_setaffinity(None, &all).unwrap();
            let aside = driver.step_aside().unwrap();
            assert_ne!(sched_getcpu(), core);
            assert!(!sched_getaffinity(None).unwrap().is_set(core));
            drop(aside);
            assert_eq!(sched_getaffinity(None).unwrap(), all);
        });
    }

    #[test]
    fn who_may_use_no_other_core_stays() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        on_one_core(|core, _| {
            driver.announce();
            assert!(driver.step_aside().is_none());
            assert_eq!(sched_getcpu(), core);
        });
    }

    #[test]
    fn a_core_that_is_not_told_or_cannot_be_is_nowhere() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        assert!(driver.step_aside().is_none());
        driver.at(CORE).store(u32::MAX, Ordering::Relaxed);
        assert!(driver.step_aside().is_none());
    }

    #[test]
    fn the_count_wraps() {
        let (_folder, path) = page();
        let driver = WakeWord::create(&path).unwrap();
        driver.at(WORD).store(u32::MAX, Ordering::Relaxed);
        let seen = driver.frames();
        driver.announce();
        assert_eq!(driver.frames(), 0);
        assert!(!driver.sleep(seen, LONG));
    }

    #[test]
    fn a_driver_takes_over_the_page_of_the_one_before_and_makes_another_where_it_was_removed() {
        let (_folder, path) = page();
        assert!(WakeWord::open(&path).unwrap().is_none());
        let first = WakeWord::create(&path).unwrap();
        first.announce();
        let consumer = WakeWord::open(&path).unwrap().unwrap();
        drop(first);
        let second = WakeWord::create(&path).unwrap();
        let seen = consumer.frames();
        second.announce();
        assert_ne!(consumer.frames(), seen);
        assert!(consumer.is_current());
        fs::remove_file(&path).unwrap();
        assert!(!consumer.is_current());
        let third = WakeWord::create(&path).unwrap();
        assert!(!consumer.is_current() && third.is_current());
    }

    #[test]
    fn what_a_driver_keeps_is_found_by_the_next() {
        let (_folder, path) = page();
        let first = WakeWord::create(&path).unwrap();
        assert_eq!(first.kept(), None);
        let production = Production { counting: 1, produced: u64::from(u32::MAX) + 7, epoch: 3 };
        first.keep(&production);
        first.announce();
        drop(first);
        assert_eq!(WakeWord::create(&path).unwrap().kept(), Some(production));
        assert_eq!(WakeWord::open(&path).unwrap().unwrap().frames(), 2);
    }

    #[test]
    fn what_a_driver_of_another_contract_kept_is_not_believed() {
        let (_folder, path) = page();
        for place in [0, 1] {
            let driver = WakeWord::create(&path).unwrap();
            driver.keep(&Production { counting: 1, produced: 2, epoch: 3 });
            driver.at(place).fetch_add(1, Ordering::Relaxed);
            assert_eq!(WakeWord::create(&path).unwrap().kept(), None);
        }
    }

    #[test]
    fn a_page_that_is_not_finished_is_none() {
        let (_folder, path) = page();
        fs::write(&path, "").unwrap();
        assert!(WakeWord::open(&path).unwrap().is_none());
        fs::write(&path, [0; PAGE_BYTES]).unwrap();
        assert!(WakeWord::open(&path).unwrap().is_none());
    }
}
