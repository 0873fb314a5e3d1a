//! The frame contract of uvcam: masked camera frames over iceoryx2 shared memory.
//!
//! A consumer needs this crate alone. The driver fills a [`Slot`] of shared memory and publishes it with a [`FrameHeader`];
//! a consumer reads the same memory as a [`Frame`]. Nobody copies pixels.
//!
//! One camera is four iceoryx2 services: `uvcam/v2/<camera>/frames` carries the frames, `uvcam/v2/<camera>/wake` is the event for a
//! `WaitSet`, [`health`] tells how the camera is, and [`control`] takes questions. A consumer that only waits for a frame sleeps on a
//! futex instead ([`Wakeup`]). The driver alone creates them; driver and consumers agree on [`Settings::prefix`] and
//! [`Settings::root_path`], and
//! run under one user.
//!
//! A consumer that is slow, stuck or killed neither delays the driver nor takes its slots: the oldest frame that it has not
//! read gives way to the newest, and it is told how many it lost ([`Frame::lost_before`]).

mod cleanup;
mod clock;
mod continuity;
pub mod control;
mod error;
mod footing;
mod frame_service;
mod header;
pub mod health;
mod log;
mod pixel_format;
mod prediction;
mod premises;
mod production;
mod publisher;
mod quirks;
mod resident;
mod service;
mod settings;
mod subscriber;
mod wake_word;
mod wakeup;

pub use cleanup::cleanup_dead_nodes;
pub use clock::{monotonic_ns, realtime_ns};
pub use error::{IpcError, LoanError};
pub use footing::Footing;
pub use frame_service::{frame_service_name, wake_service_name};
pub use header::{CONTRACT_VERSION, Flags, FrameHeader, HeaderError, MAGIC};
pub use log::log_to;
pub use pixel_format::{PixelFormat, UnknownPixelFormat};
pub use publisher::{Publisher, Slot};
pub use settings::Settings;
pub use subscriber::{Frame, Subscriber};
pub use wakeup::Wakeup;
