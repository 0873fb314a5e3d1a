//! The wake word: how a driver wakes consumers that only wait for a frame, in about half of the time that an event takes.
//!
//! One page of shared memory for each camera, `/dev/shm/<prefix><camera>.<device>-<inode>.wake`, which the driver makes with its publisher;
//! device and inode are those of `root_path`, hexadecimal. It stays when the driver stops or is killed, as it also keeps how far the camera
//! has come, from where the next driver goes on. Part of the contract, little-endian:
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..4 | "UVCW" |
//! | 4..8 | [`CONTRACT_VERSION`](crate::CONTRACT_VERSION) |
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
//!   that starts takes over the page of the one before, and wakes its sleepers: who was killed between the exchange and the wake-up
//!   left them asleep without the bit.
//! * A consumer watches for a frame on another core than the driver's only: there it would keep the driver from sending it.
//! * A sleep ends after 100 ms at the latest, for a look at whether driver and page are still the right ones.
//!
//! Laws of its memory:
//! 1. The mapping covers the whole page and lives as long as the [`WakeWord`]; the page is checked to have its size before it is used, and
//!    nobody makes it smaller: driver and consumers run under one user.
//! 2. The page is reached through atomics alone, as other processes write to it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read};
use std::mem::offset_of;
use std::num::NonZeroU64;
use std::ops::Deref;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::ptr::{self, NonNull};
use std::time::Duration;

use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::{
    CpuSet, current_timer_slack, sched_getaffinity, sched_setaffinity, set_current_timer_slack,
};

use crate::production::Production;

mod page;
mod system;

use page::Page;

const PAGE_BYTES: usize = 4096;

macro_rules! assert_offsets {
    ($($line:ident.$field:ident: $offset:literal),+ $(,)?) => {
        $(const _: () = assert!(offset_of!(Page, $line.$field) == $offset);)+
    };
}

assert_offsets! {
    identity.magic: 0, identity.contract_version: 4, wake.word: 64, wake.core: 68, count.counting: 128, count.produced: 136,
    count.epoch: 144,
}
const _: () = assert!(size_of::<Page>() <= PAGE_BYTES);

/// The wake word of one camera.
#[derive(Debug)]
pub(crate) struct WakeWord {
    page: NonNull<Page>,
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
        word.take_over();
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

    fn map(file: &File, path: &Path) -> io::Result<WakeWord> {
        let found = file.metadata()?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping, at an address of the kernel's choice, touches no other memory.
        let page = unsafe { mmap(ptr::null_mut(), PAGE_BYTES, access, MapFlags::SHARED, file, 0) }?;
        let page = NonNull::new(page.cast()).ok_or(io::ErrorKind::AddrNotAvailable)?;
        Ok(WakeWord { page, path: path.to_owned(), file: (found.dev(), found.ino()) })
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

    /// As [`Page::sleep`], for a `timeout` that is to be met: without the 50 us that the system may add to it (PR_SET_TIMERSLACK,
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
    pub(crate) fn step_aside(&self) -> Option<AffinityGuard> {
        let core = self.core()? as usize;
        // Another process wrote the number.
        if core >= CpuSet::MAX_CPU {
            return None;
        }
        let usual = sched_getaffinity(None).ok()?;
        let mut others = usual;
        others.unset(core);
        // Fails where there are no others.
        sched_setaffinity(None, &others).ok()?;
        Some(AffinityGuard { usual })
    }

    /// Whether its name still leads to this page: where it was removed, the next driver makes another one.
    pub(crate) fn is_current(&self) -> bool {
        fs::metadata(&self.path).is_ok_and(|found| (found.dev(), found.ino()) == self.file)
    }
}

/// The version of the contract that a page tells of; `None` where there is none.
pub(crate) fn version_of(path: &Path) -> Option<u32> {
    let mut identity = [0; 8];
    options().open(path).and_then(|mut file| file.read_exact(&mut identity)).ok()?;
    let (magic, version) = identity.split_first_chunk()?;
    (*magic == page::MAGIC.to_le_bytes()).then_some(u32::from_le_bytes(version.try_into().ok()?))
}

/// How the page is opened: never through a link, which anybody can put into `/dev/shm`.
fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags(OFlags::NOFOLLOW.bits().cast_signed());
    options
}

impl Deref for WakeWord {
    type Target = Page;

    fn deref(&self) -> &Page {
        // SAFETY: laws 1 and 2: a mapping is aligned for any number, the page is longer than its numbers, all of which are atomics, and any
        // bytes are valid for these.
        unsafe { self.page.as_ref() }
    }
}

impl Drop for WakeWord {
    fn drop(&mut self) {
        // SAFETY: law 1: the mapping is this value's own, and no reference outlives it.
        let _ = unsafe { munmap(self.page.as_ptr().cast(), PAGE_BYTES) };
    }
}

/// While it lives, this thread stays away from the driver's core.
#[must_use]
pub(crate) struct AffinityGuard {
    usual: CpuSet,
}

impl Drop for AffinityGuard {
    fn drop(&mut self) {
        // The thread is the consumer's.
        let _ = sched_setaffinity(None, &self.usual);
    }
}

#[cfg(test)]
mod tests;
