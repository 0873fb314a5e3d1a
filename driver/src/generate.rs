//! Generate-mode: from a request to a mask. The frame path with another ending: lit frames go to a generator instead of to consumers.
//!
//! ```text
//!                    Request ──> Task ──> Collector ──> LitFrames ──> Generated ──> candidate, report
//! of                 a command            the camera                  the mask       its files
//! walked by          the main thread      the camera's thread         a worker       a worker
//! ```
//!
//! Each step takes what the one before made, and gives it on for good. A camera's thread walks its step between two epochs of its stream, and
//! tells of the lit frames when the camera has its flight settings again. They are no part of a stream: no consumer has lost them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

mod candidate;
mod collector;
mod generator;
mod light;
mod lit_frames;
mod request;

pub use candidate::{Generated, parts};
pub use collector::Collector;
pub use generator::Generator;
pub use lit_frames::LitFrames;
pub use request::{Request, RequestError};

/// A request on its way through the driver.
#[derive(Debug)]
pub struct Task {
    /// What is to be done.
    pub request: Request,
    /// How whoever requested it ends it early.
    pub cancel: CancelToken,
}

/// Ends a task early, from any thread. Its clones belong to the same task.
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// Nothing more is to be done for the task.
    pub fn cancel(&self) {
        // Relaxed: the flag carries no data.
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the task was ended early.
    pub fn is_cancelled(&self) -> bool {
        // Relaxed: as in `cancel`.
        self.0.load(Ordering::Relaxed)
    }

    /// Whether both belong to the same task.
    pub fn is_of_same_task(&self, other: &CancelToken) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
