//! A consumer's end of a camera.

use std::ffi::c_char;
use std::sync::{Mutex, TryLockError};
use std::time::Duration;

use uvcam_shm_ipc::{Frame, IpcError, Subscriber, Wakeup};

use crate::argument;
use crate::error::{Failure, UVCAM_NONE, UVCAM_OK, call, uvcam_status};
use crate::frame::{FRAMES, uvcam_frame};
use crate::handle::Table;
use crate::settings::{self, uvcam_settings};

const KIND: &str = "a subscriber";

/// A consumer's end of one camera. One thread at a time may use it, whichever: a call meanwhile fails with UVCAM_ERROR_BUSY.
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_subscriber(());

/// How uvcam_wait() waits.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub enum uvcam_wakeup {
    /// Sleeps until the driver has sent a frame. The default; costs nothing while it sleeps.
    UVCAM_WAKEUP_FUTEX = 0,
    /// Sleeps until shortly before the next frame is due, then watches for it, for less than 1 % of the frame period on average. The
    /// shortest wake-up, for cameras with a steady rate. The calling thread's affinity is without the driver's core while it sleeps.
    UVCAM_WAKEUP_PREDICTIVE = 1,
    /// Sleeps on the camera's iceoryx2 event. Slower to wake, and slower for the driver.
    UVCAM_WAKEUP_EVENT = 2,
}

/// What a subscriber has counted since it was opened.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_counters {
    /// Frames given out, or passed over by uvcam_receive_latest().
    pub frames: u64,
    /// Sum of `lost_before` over all frames.
    pub lost: u64,
    /// Streams seen: 1 with the first frame, one more with each start of the driver and each reconnection of its camera.
    pub epochs: u64,
    /// Frames dropped because their header was not to be trusted.
    pub rejected: u64,
    /// Whether a driver is there, as far as is known.
    pub connected: bool,
}

static SUBSCRIBERS: Table<Mutex<Subscriber>> = Table::new(KIND);

/// Prepares to read the frames of a camera. The driver may come later, go, and come back: the subscriber finds it again by itself.
///
/// `camera` is its name in the driver's configuration. `settings` may be NULL for the defaults. `subscriber` becomes NULL where this fails.
///
/// # Safety
/// Law 1 for `camera` and the members of `settings`, law 2 for `settings`, law 3 for `subscriber`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_open(
    camera: *const c_char,
    settings: *const uvcam_settings,
    subscriber: *mut *mut uvcam_subscriber,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(subscriber, "a place for a subscriber") }?;
        let place = place.write(std::ptr::null_mut());
        // SAFETY: law 1.
        let camera = unsafe { argument::camera(camera) }?;
        // SAFETY: laws 1 and 2.
        let settings = unsafe { settings::read(settings) }?;
        *place = SUBSCRIBERS.insert(Mutex::new(Subscriber::open(&settings, camera)?));
        Ok(UVCAM_OK)
    })
}

/// Closes a subscriber. Frames that the program holds stay valid until they are released.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_close(subscriber: *mut uvcam_subscriber) -> uvcam_status {
    call(|| {
        let found = SUBSCRIBERS.get(subscriber)?;
        // One that has panicked can be closed.
        if let Err(TryLockError::WouldBlock) = found.try_lock() {
            return Err(Failure::busy(KIND));
        }
        SUBSCRIBERS.remove(subscriber).map(|_| UVCAM_OK)
    })
}

/// Chooses how uvcam_wait() waits: one of uvcam_wakeup.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_set_wakeup(subscriber: *mut uvcam_subscriber, wakeup: u32) -> uvcam_status {
    const FUTEX: u32 = uvcam_wakeup::UVCAM_WAKEUP_FUTEX as u32;
    const PREDICTIVE: u32 = uvcam_wakeup::UVCAM_WAKEUP_PREDICTIVE as u32;
    const EVENT: u32 = uvcam_wakeup::UVCAM_WAKEUP_EVENT as u32;
    call(|| {
        using(subscriber, |subscriber| {
            subscriber.set_wakeup(match wakeup {
                FUTEX => Wakeup::Futex,
                PREDICTIVE => Wakeup::Predictive,
                EVENT => Wakeup::Event,
                other => {
                    let text = format!("{other} is not a wake-up: use one of uvcam_wakeup, 0 to {EVENT}");
                    return Err(Failure::argument(text));
                }
            });
            Ok(UVCAM_OK)
        })
    })
}

/// Waits until a frame may be there, at most `timeout_ms`: UVCAM_OK, or UVCAM_NONE where none came. A signal handler does not end it.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_wait(subscriber: *mut uvcam_subscriber, timeout_ms: u32) -> uvcam_status {
    call(|| {
        using(subscriber, |subscriber| {
            let has_come = subscriber.wait(Duration::from_millis(timeout_ms.into()))?;
            Ok(if has_come { UVCAM_OK } else { UVCAM_NONE })
        })
    })
}

/// Gives the oldest unread frame: UVCAM_OK, or UVCAM_NONE where there is none. Never waits. Called after each uvcam_wait() until it gives
/// UVCAM_NONE, it yields every frame. `frame` becomes NULL where there is none, and is to be released where there is one.
///
/// # Safety
/// Law 3 for `frame`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_receive(
    subscriber: *mut uvcam_subscriber,
    frame: *mut *mut uvcam_frame,
) -> uvcam_status {
    // SAFETY: law 3.
    unsafe { receive(subscriber, frame, Subscriber::receive) }
}

/// Gives the newest unread frame, and drops those before it: they do not count as lost. Else as uvcam_receive().
///
/// # Safety
/// Law 3 for `frame`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_receive_latest(
    subscriber: *mut uvcam_subscriber,
    frame: *mut *mut uvcam_frame,
) -> uvcam_status {
    // SAFETY: law 3.
    unsafe { receive(subscriber, frame, Subscriber::receive_latest) }
}

/// Tells what a subscriber has counted.
///
/// # Safety
/// Law 3 for `counters`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_get_counters(
    subscriber: *mut uvcam_subscriber,
    counters: *mut uvcam_counters,
) -> uvcam_status {
    call(|| {
        using(subscriber, |subscriber| {
            // SAFETY: law 3.
            let place = unsafe { argument::place(counters, "a place for counters") }?;
            place.write(uvcam_counters {
                frames: subscriber.frames(),
                lost: subscriber.lost(),
                epochs: subscriber.epochs(),
                rejected: subscriber.rejected(),
                connected: subscriber.is_connected(),
            });
            Ok(UVCAM_OK)
        })
    })
}

/// # Safety
/// Law 3 for `frame`.
unsafe fn receive(
    subscriber: *mut uvcam_subscriber,
    frame: *mut *mut uvcam_frame,
    take: impl FnOnce(&mut Subscriber) -> Result<Option<Frame>, IpcError>,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3. Looked at before a frame is taken that nobody could release.
        let place = unsafe { argument::place(frame, "a place for a frame") }?;
        let place = place.write(std::ptr::null_mut());
        let Some(frame) = using(subscriber, |subscriber| Ok(take(subscriber)?))? else {
            return Ok(UVCAM_NONE);
        };
        *place = FRAMES.insert(frame);
        Ok(UVCAM_OK)
    })
}

/// Calls `body` with what a handle stands for, while no other thread uses it.
pub(crate) fn using<T>(
    subscriber: *mut uvcam_subscriber,
    body: impl FnOnce(&mut Subscriber) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let subscriber = SUBSCRIBERS.get(subscriber)?;
    match subscriber.try_lock() {
        Ok(mut subscriber) => body(&mut subscriber),
        Err(TryLockError::WouldBlock) => Err(Failure::busy(KIND)),
        Err(TryLockError::Poisoned(_)) => Err(Failure::fault("this subscriber has failed before: close it")),
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::{CStr, CString};
    use std::fs;

    use uvcam_shm_ipc::iceoryx2::prelude::*;
    use uvcam_shm_ipc::{Publisher, Settings};

    use super::*;
    use crate::error::{UVCAM_ERROR_INCOMPATIBLE, uvcam_error_text};

    #[test]
    fn a_driver_of_another_contract_is_refused_with_both_versions() {
        let folder = tempfile::tempdir().unwrap();
        let prefix: String =
            folder.path().to_string_lossy().chars().filter(char::is_ascii_alphanumeric).collect();
        let settings = Settings::new(format!("{prefix}_"), folder.path());
        drop(Publisher::create(&settings, "left", 64, 1).unwrap());
        // What a driver of version 9 leaves in the camera's page, and its service.
        let mut files = fs::read_dir("/dev/shm").unwrap().flatten().map(|file| file.path());
        let is_page = |file: &std::path::PathBuf| {
            file.extension().is_some_and(|end| end == "wake") && file.to_string_lossy().contains(&prefix)
        };
        let page = files.find(is_page).unwrap();
        let mut bytes = fs::read(&page).unwrap();
        bytes[4] = 9;
        fs::write(&page, bytes).unwrap();
        let node = NodeBuilder::new().config(&settings.to_iceoryx2().unwrap());
        let node = node.create::<ipc_threadsafe::Service>().unwrap();
        let name = ServiceName::new("uvcam/v9/left/frames").unwrap();
        let service = node.service_builder(&name).publish_subscribe::<u64>().create().unwrap();

        let prefix = CString::new(settings.prefix).unwrap();
        let root_path = CString::new(settings.root_path.to_str().unwrap()).unwrap();
        let settings = uvcam_settings { prefix: prefix.as_ptr(), root_path: root_path.as_ptr() };
        let mut subscriber = std::ptr::dangling_mut();
        // SAFETY: laws 1 to 3; all of it is this test's.
        let status = unsafe { uvcam_open(c"left".as_ptr(), &settings, &mut subscriber) };
        // SAFETY: a text of this thread, which reads it before its next call.
        let text = unsafe { CStr::from_ptr(uvcam_error_text()) }.to_str().unwrap();
        assert_eq!((status, subscriber), (UVCAM_ERROR_INCOMPATIBLE, std::ptr::null_mut()), "{text}");
        for words in ["\"left\"", "version 9 of the contract", "this program has version 2"] {
            assert!(text.contains(words), "{text}");
        }
        drop((service, node));
        fs::remove_file(page).unwrap();
    }
}
