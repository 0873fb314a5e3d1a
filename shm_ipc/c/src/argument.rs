//! Arguments as C hands them over: pointers that may be NULL.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;

use crate::error::Failure;

/// A text; `None` for NULL. `what` as in "a camera's name".
///
/// # Safety
/// Law 1.
pub(crate) unsafe fn text<'a>(text: *const c_char, what: &str) -> Result<Option<&'a str>, Failure> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: law 1.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map(Some).map_err(|_| Failure::argument(format!("{text:?} is not {what}: use UTF-8")))
}

/// The place for a result. `what` as in "a place for a frame".
///
/// # Safety
/// Law 3.
pub(crate) unsafe fn place<'a, T>(place: *mut T, what: &str) -> Result<&'a mut MaybeUninit<T>, Failure> {
    // SAFETY: law 3; a `MaybeUninit` may hold any bytes.
    unsafe { place.cast::<MaybeUninit<T>>().as_mut() }.ok_or_else(|| Failure::null(what))
}

/// The name of a camera, which must be given.
///
/// # Safety
/// Law 1.
pub(crate) unsafe fn camera<'a>(name: *const c_char) -> Result<&'a str, Failure> {
    // SAFETY: law 1.
    unsafe { text(name, "a camera's name") }?.ok_or_else(|| Failure::null("a camera's name"))
}
