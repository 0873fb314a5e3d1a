//! Pictures on their way from the disk, a few frames ahead of their time.
//!
//! A thread of its own reads and decodes them in turn. It waits where it is [`AHEAD`] pictures ahead, so that a folder takes no more
//! memory than these, however many it holds; and it leaves out what is no longer wanted, so that a slow disk costs frames and not the rhythm.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use tracing::{debug, warn};
use uvcam_masker::GrayImage;
use uvcam_masker::file::read_frame;
use uvcam_shm_ipc::monotonic_ns;

use super::folder::Folder;
use crate::causes::with_causes;
use crate::realtime;

/// Pictures that may wait for their time; an eighth of a second at 60 frames a second.
const AHEAD: usize = 8;

/// The reading thread, and the way from it. Dropping it ends the thread.
#[derive(Debug)]
pub(super) struct Ahead {
    /// There until it is dropped: the thread ends when nobody receives.
    pictures: Option<Receiver<Picture>>,
    /// The first frame that may still be asked for.
    wanted: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Picture {
    frame_id: u64,
    /// `None` where it could not be read.
    pixels: Option<Vec<u8>>,
}

/// What came of waiting for a picture.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// Its pixels, as many as the size has.
    Whole(Vec<u8>),
    /// It cannot be read, or has another size.
    Broken,
    /// It is not there yet.
    Late,
    /// The thread ended, which it does not do by itself.
    Ended,
}

impl Ahead {
    /// Starts to read pictures of `size`, columns and rows, from the first one on.
    pub(super) fn start(folder: Arc<Folder>, size: (u32, u32)) -> io::Result<Self> {
        let (sender, pictures) = sync_channel(AHEAD);
        let wanted = Arc::new(AtomicU64::new(0));
        let asked = wanted.clone();
        let name = std::thread::current().name().map_or("replay".into(), |name| format!("{name}-read"));
        let thread = Builder::new().name(name).spawn(move || {
            // The camera's thread comes first where both share a core.
            realtime::leave();
            read_all(&folder, size, &sender, &asked);
        })?;
        Ok(Ahead { pictures: Some(pictures), wanted, thread: Some(thread) })
    }

    /// The picture of a frame, waited for until the instant `deadline_ns`. Frames are asked for in growing order; one that came late
    /// can be asked for again.
    pub(super) fn take(&self, frame_id: u64, deadline_ns: u64) -> Taken {
        // Relaxed: the number carries no other data.
        self.wanted.store(frame_id, Ordering::Relaxed);
        let Some(pictures) = &self.pictures else { return Taken::Ended };
        loop {
            let left = Duration::from_nanos(deadline_ns.saturating_sub(monotonic_ns()));
            match pictures.recv_timeout(left) {
                Ok(picture) if picture.frame_id < frame_id => {}
                Ok(Picture { pixels: Some(pixels), .. }) => return Taken::Whole(pixels),
                Ok(Picture { pixels: None, .. }) => return Taken::Broken,
                Err(RecvTimeoutError::Timeout) => return Taken::Late,
                Err(RecvTimeoutError::Disconnected) => return Taken::Ended,
            }
        }
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        self.pictures = None;
        if let Some(thread) = self.thread.take() {
            // A panic was told when it happened.
            let _ = thread.join();
        }
    }
}

/// Reads one picture after another until nobody receives.
fn read_all(folder: &Folder, size: (u32, u32), pictures: &SyncSender<Picture>, wanted: &AtomicU64) {
    let mut frame_id = 0;
    let mut is_told = false;
    loop {
        frame_id = wanted.load(Ordering::Relaxed).max(frame_id);
        let read = read(folder, frame_id, size);
        let pixels = read.map(GrayImage::into_raw).map_err(|cause| {
            // Once: they come again and again.
            if is_told {
                debug!("{cause}; its frame is lost");
            } else {
                warn!("{cause}; its frame is lost, as are those of all such pictures (UVCAM_LOG=debug names them)");
            }
            is_told = true;
        });
        if pictures.send(Picture { frame_id, pixels: pixels.ok() }).is_err() {
            return;
        }
        frame_id += 1;
    }
}

/// Fails with what is wrong with the picture.
fn read(folder: &Folder, frame_id: u64, (width, height): (u32, u32)) -> Result<GrayImage, String> {
    let path = folder.picture(frame_id);
    let picture = read_frame(&path).map_err(|error| with_causes(&error))?.gray;
    match picture.dimensions() {
        found if found == (width, height) => Ok(picture),
        (other_width, other_height) => {
            Err(format!("`{}` has {other_width}x{other_height} px, not {width}x{height}", path.display()))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const SIZE: (u32, u32) = (4, 2);
    const NEVER: u64 = u64::MAX;

    fn write(folder: &Path, index: u8) {
        let picture = GrayImage::from_pixel(SIZE.0, SIZE.1, image::Luma([index]));
        picture.save(folder.join(format!("{index}.png"))).unwrap();
    }

    fn ahead_of(folder: &Path) -> Ahead {
        Ahead::start(Arc::new(Folder::list(folder).unwrap()), SIZE).unwrap()
    }

    fn whole(level: u8) -> Taken {
        Taken::Whole(vec![level; 8])
    }

    #[test]
    fn pictures_come_in_turn_and_again() {
        let folder = tempfile::tempdir().unwrap();
        (0..3).for_each(|index| write(folder.path(), index));
        let ahead = ahead_of(folder.path());
        for frame_id in 0..9 {
            assert_eq!(ahead.take(frame_id, NEVER), whole((frame_id % 3) as u8));
        }
    }

    #[test]
    fn no_more_are_read_than_a_few_ahead() {
        let folder = tempfile::tempdir().unwrap();
        (0..100).for_each(|index| write(folder.path(), index));
        let ahead = ahead_of(folder.path());
        assert_eq!(ahead.take(0, NEVER), whole(0));
        // All that may wait, the one that is being read, and the one that was taken.
        for index in AHEAD + 2..100 {
            std::fs::remove_file(folder.path().join(format!("{index}.png"))).unwrap();
        }
        for frame_id in 1..100 {
            let taken = ahead.take(frame_id, NEVER);
            let was_read = taken == whole(frame_id as u8);
            assert!(was_read || taken == Taken::Broken, "{taken:?}");
            assert!(!was_read || frame_id < AHEAD as u64 + 2, "frame {frame_id} was read ahead");
        }
    }

    #[test]
    fn what_is_no_longer_wanted_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        (0..100).for_each(|index| write(folder.path(), index));
        let ahead = ahead_of(folder.path());
        for frame_id in [0, 1, 50, 51, 250] {
            assert_eq!(ahead.take(frame_id, NEVER), whole((frame_id % 100) as u8));
        }
    }

    #[test]
    fn what_is_late_can_be_asked_for_again() {
        let folder = tempfile::tempdir().unwrap();
        (0..2).for_each(|index| write(folder.path(), index));
        let ahead = ahead_of(folder.path());
        // A picture far ahead is never there at once.
        assert_eq!(ahead.take(1001, 0), Taken::Late);
        assert_eq!(ahead.take(1001, NEVER), whole(1));
    }

    #[test]
    fn a_picture_that_cannot_be_used_is_told_and_the_next_ones_come() {
        let folder = tempfile::tempdir().unwrap();
        (0..5).for_each(|index| write(folder.path(), index));
        std::fs::write(folder.path().join("1.png"), "no picture").unwrap();
        GrayImage::new(SIZE.1, SIZE.0).save(folder.path().join("2.png")).unwrap();
        std::fs::remove_file(folder.path().join("3.png")).unwrap();
        std::fs::create_dir(folder.path().join("3.png")).unwrap();
        let ahead = ahead_of(folder.path());
        for frame_id in 0..10 {
            let expected = match frame_id % 5 {
                0 | 4 => whole((frame_id % 5) as u8),
                _ => Taken::Broken,
            };
            assert_eq!(ahead.take(frame_id, NEVER), expected, "frame {frame_id}");
        }
        let list = Folder::list(folder.path()).unwrap();
        assert!(read(&list, 1, SIZE).unwrap_err().contains("1.png` is not a sound PNG image"));
        assert!(read(&list, 2, SIZE).unwrap_err().ends_with("2.png` has 2x4 px, not 4x2"));
    }
}
