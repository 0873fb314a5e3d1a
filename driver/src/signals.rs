//! Signals as events.

use std::ffi::c_int;

use signal_hook::iterator::Signals;
use signal_hook::iterator::backend::Handle;

use crate::error::Error;
use crate::thread::spawn;

/// Hands each of these signals that comes to `tell`, on a thread of its own, until the handle is closed.
///
/// # Errors
/// [`Error::System`] where the system gives no thread or no signals.
pub(crate) fn listen(numbers: &[c_int], tell: impl Fn(c_int) + Send + 'static) -> Result<Handle, Error> {
    let mut signals = Signals::new(numbers).map_err(|source| Error::System {
        doing: "listening to",
        path: "signals".into(),
        source,
    })?;
    let handle = signals.handle();
    spawn("signals", move || signals.forever().for_each(tell))?;
    Ok(handle)
}
