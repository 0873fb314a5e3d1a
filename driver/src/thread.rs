//! Threads with a name.

use std::thread::{Builder, JoinHandle};

use crate::error::Error;

/// Starts a thread.
///
/// # Errors
/// [`Error::System`] where the system gives none.
pub(crate) fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, Error> {
    Builder::new().name(name.into()).spawn(body).map_err(|source| Error::System {
        doing: "starting thread",
        path: name.into(),
        source,
    })
}
