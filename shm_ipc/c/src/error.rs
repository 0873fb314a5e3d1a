//! What went wrong, as C programs hear of it: a status, and a text for each thread.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

use uvcam_shm_ipc::{IpcError, IpcErrorKind};

/// What came of a call: UVCAM_OK, UVCAM_NONE, or a negative number for an error, of which uvcam_error_text() says more.
///
/// New errors may come with new versions: treat every negative number as one.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub enum uvcam_status {
    /// Done.
    UVCAM_OK = 0,
    /// Done, and there is nothing: no unread frame, no frame in time, no driver.
    UVCAM_NONE = 1,
    /// An argument that cannot be: NULL, a camera name, a setting.
    UVCAM_ERROR_ARGUMENT = -1,
    /// A handle that was closed or released before, or never given out.
    UVCAM_ERROR_HANDLE = -2,
    /// Another thread is using this handle just now.
    UVCAM_ERROR_BUSY = -3,
    /// The program holds as many frames, or masks, of this subscriber as it may: release one.
    UVCAM_ERROR_TOO_MANY_HELD = -4,
    /// The camera has as many consumers as it can have.
    UVCAM_ERROR_TOO_MANY_CONSUMERS = -5,
    /// The driver, or a file that is needed, belongs to another user.
    UVCAM_ERROR_PERMISSION = -6,
    /// The driver speaks another version of the contract, or a service does not fit.
    UVCAM_ERROR_INCOMPATIBLE = -7,
    /// Shared memory or a limit of the system leaves too little.
    UVCAM_ERROR_NO_ROOM = -8,
    /// Anything else that the system reports.
    UVCAM_ERROR_SYSTEM = -9,
    /// The mask of a frame has not come yet: ask again with the next frame.
    UVCAM_ERROR_MASK_PENDING = -10,
    /// A fault of this library. What it happened to is best closed.
    UVCAM_ERROR_FAULT = -11,
}

pub(crate) use uvcam_status::*;

/// Why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    status: uvcam_status,
    text: String,
}

impl Failure {
    pub(crate) fn argument(text: String) -> Self {
        Failure { status: UVCAM_ERROR_ARGUMENT, text }
    }

    /// `what` as in "a frame".
    pub(crate) fn null(what: &str) -> Self {
        Failure::argument(format!("NULL is not {what}: pass {what}"))
    }

    pub(crate) fn handle(kind: &str, number: usize) -> Self {
        let text = format!("{number} is not {kind}: it was closed or released before, or never was one");
        Failure { status: UVCAM_ERROR_HANDLE, text }
    }

    pub(crate) fn busy(kind: &str) -> Self {
        let text = format!(
            "another thread is using {kind}: let one thread at a time use it, or open one for each thread"
        );
        Failure { status: UVCAM_ERROR_BUSY, text }
    }

    pub(crate) fn fault(text: &str) -> Self {
        Failure { status: UVCAM_ERROR_FAULT, text: format!("a fault of libuvcam, please report it: {text}") }
    }

    fn panicked(panic: &(dyn Any + Send)) -> Self {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        Failure::fault(text.or_else(|| panic.downcast_ref().copied()).unwrap_or("a panic without words"))
    }

    /// Keeps the text for uvcam_error_text().
    #[cold]
    fn tell(self) -> uvcam_status {
        let text = CString::new(self.text.replace('\0', "\u{fffd}")).unwrap_or_default();
        // Where the thread is just ending, nobody is left to read it.
        let _ = LAST.try_with(|last| *last.borrow_mut() = text);
        self.status
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.text)
    }
}

impl From<IpcError> for Failure {
    fn from(error: IpcError) -> Self {
        let status = match error.kind() {
            IpcErrorKind::CameraName | IpcErrorKind::Setting => UVCAM_ERROR_ARGUMENT,
            IpcErrorKind::MaskPending => UVCAM_ERROR_MASK_PENDING,
            IpcErrorKind::TooManyHeld => UVCAM_ERROR_TOO_MANY_HELD,
            IpcErrorKind::TooManyConsumers => UVCAM_ERROR_TOO_MANY_CONSUMERS,
            IpcErrorKind::Permission | IpcErrorKind::Foreign | IpcErrorKind::Unwritable => {
                UVCAM_ERROR_PERMISSION
            }
            IpcErrorKind::Incompatible | IpcErrorKind::OtherVersion => UVCAM_ERROR_INCOMPATIBLE,
            IpcErrorKind::NoRoom
            | IpcErrorKind::SharedMemoryFull
            | IpcErrorKind::NotMapped
            | IpcErrorKind::TooFewFiles
            | IpcErrorKind::AddressSpace => UVCAM_ERROR_NO_ROOM,
            _ => UVCAM_ERROR_SYSTEM,
        };
        Failure { status, text: error.to_string() }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// What the last call of this thread that failed had to say: what is wrong, where, and what mends it. UTF-8; empty where none has failed.
/// Valid until another call of this thread fails, or the thread ends.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_error_text() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Runs what a function of the interface does. No panic leaves it.
pub(crate) fn call(body: impl FnOnce() -> Result<uvcam_status, Failure>) -> uvcam_status {
    // What a panic has left half done is either a value of one call, or behind a mutex that remembers it.
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(status)) => status,
        Ok(Err(failure)) => failure.tell(),
        Err(panic) => Failure::panicked(&*panic).tell(),
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn text() -> String {
        // SAFETY: a text of this thread, which reads it before its next call.
        unsafe { CStr::from_ptr(uvcam_error_text()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn a_panic_is_an_error() {
        assert_eq!(call(|| panic!("{} frames", 3)), UVCAM_ERROR_FAULT);
        assert!(text().ends_with("please report it: 3 frames"), "{}", text());
        assert_eq!(call(|| panic!("plain")), UVCAM_ERROR_FAULT);
        assert!(text().ends_with("plain"), "{}", text());
    }

    #[test]
    fn a_thread_has_its_own_text_and_keeps_it_until_the_next_failure() {
        assert_eq!(call(|| Err(Failure::null("a frame"))), UVCAM_ERROR_ARGUMENT);
        assert_eq!(call(|| Ok(UVCAM_NONE)), UVCAM_NONE);
        std::thread::spawn(|| assert_eq!(text(), "")).join().unwrap();
        assert_eq!(text(), "NULL is not a frame: pass a frame");
    }

    #[test]
    fn a_text_with_a_zero_byte_keeps_its_rest() {
        assert_eq!(call(|| Err(Failure::argument("a\0b".to_owned()))), UVCAM_ERROR_ARGUMENT);
        assert_eq!(text(), "a\u{fffd}b");
    }
}
