//! The frame contract of uvcam: masked camera frames over iceoryx2 shared memory.
//!
//! A consumer needs this crate alone. The driver fills a [`Slot`] of shared memory and publishes it with a [`FrameHeader`]; a consumer
//! reads the same memory as a [`Frame`]. Nobody copies pixels. A consumer that is slow, stuck or killed neither delays the driver nor takes
//! its slots: the oldest frame that it has not read gives way to the newest, and it is told how many it lost.
//!
//! # A consumer
//!
//! ```no_run
//! use std::time::Duration;
//! use uvcam_shm_ipc::{Flags, IpcError, Settings, Subscriber};
//!
//! /// Looks for other UAVs in frames of the camera "left".
//! fn consume(detect: impl Fn(&[u8], usize)) -> Result<(), IpcError> {
//!     let mut subscriber = Subscriber::open(&Settings::default(), "left")?;
//!     loop {
//!         if !subscriber.wait(Duration::from_secs(1))? {
//!             eprintln!("no frame for a second");
//!         }
//!         while let Some(frame) = subscriber.receive()? {
//!             let header = frame.header();
//!             if frame.epoch_changed() {
//!                 eprintln!("driver or camera started anew: what was tracked across frames is old");
//!             }
//!             if frame.lost_before() > 0 {
//!                 eprintln!("lost {} frames before {}", frame.lost_before(), header.sequence);
//!             }
//!             if !header.flags.contains(Flags::MASKED) {
//!                 eprintln!("not masked: the own airframe is in sight");
//!             }
//!             // Row by row, `stride` bytes apart; `frame.rows()` gives them one by one.
//!             detect(frame.pixels(), header.stride as usize);
//!         }
//!     }
//! }
//! ```
//!
//! **Open.** [`Subscriber::open`] takes the [`Settings`] and the name of a camera. Driver and consumers must agree on
//! [`Settings::prefix`] and [`Settings::root_path`], and run under one user; the numbers are the driver's. The driver may come later, go,
//! and come back: the subscriber finds it again by itself, and [`Subscriber::is_connected`] tells whether it has.
//!
//! **Wait.** [`Subscriber::wait`] sleeps until a frame is there, at most as long as it is told to. [`Subscriber::set_wakeup`] chooses how:
//! [`Wakeup`] compares what each way costs. A program with a `WaitSet` of its own attaches a listener of the event service
//! [`wake_service_name`], which it opens with [`Settings::to_iceoryx2`] and the crate [`iceoryx2`] as it is given out here.
//!
//! **Receive.** After each wait, [`Subscriber::receive`] gives every frame, oldest first, until there is none;
//! [`Subscriber::receive_latest`] gives the newest and passes over the others. A [`Frame`] is the driver's own memory: it stays as it is
//! until it is dropped, and a consumer may hold [`Settings::borrowed`] of them. The header is a checked copy; [`FrameHeader`] describes
//! each field, and [`FrameHeader::pixel_format`] how a pixel lies in memory. A frame whose header is not to be trusted is dropped and
//! counted by [`Subscriber::rejected`].
//!
//! **Loss.** [`Frame::lost_before`] is how many frames the device produced since the frame before and this consumer did not get, for
//! whatever reason: incomplete, never published, read too late, or while the driver was away. [`Subscriber::lost`] is their sum.
//! [`FrameHeader`] tells how they are counted.
//!
//! **Epochs.** An epoch is one uninterrupted stream. Driver and camera may start anew at any time, maybe with other settings:
//! [`Frame::epoch_changed`] says so with the first frame. Within one epoch, size, format, stride, exposure and gain stay as they are.
//! Epochs rise, whatever the clock does.
//!
//! **Masks.** Under [`Flags::MASKED`], pixels of the own airframe are zero, and [`FrameHeader::mask_id`] is the identity of the mask that
//! blanked them, 16 bytes that `uvcam` prints as 32 hexadecimal digits. It may change from one frame to the next.
//! [`Subscriber::mask_of`] gives the [`Mask`] of a frame: an image and its runs, without a copy, and grown for a detector that must not
//! see the edge of a black area. Under [`Flags::MASK_ATTACHED`], frames are as the camera took them, and only the mask tells where the
//! airframe is: a consumer that does not ask for it refuses such frames.
//!
//! **Stamps.** [`FrameHeader::mid_exposure_monotonic_ns`] is when the picture was taken, on the clock that all processes of a host share
//! ([`monotonic_ns`]); [`FrameHeader::mid_exposure_realtime_ns`] the same for other hosts ([`realtime_ns`]), which may step.
//! [`FrameHeader::mid_exposure_uncertainty_ns`] bounds the error of both. [`FrameHeader::send_monotonic_ns`] is when the frame was sent: now
//! minus this is how old it is to its consumer.
//!
//! **Errors.** An [`IpcError`] says what is wrong and where ([`IpcError::message`]) and what mends it ([`IpcError::remedy`]); a program
//! matches on its [`IpcError::kind`]. A driver that is absent is none: [`Subscriber::receive`] then gives `None`. After
//! [`IpcErrorKind::TooManyHeld`], drop a frame and go on. What may pass by itself, as a full `/dev/shm`, is tried again for some seconds
//! before it is told; after any error, the next call tries again.
//!
//! # Beside the frames
//!
//! [`health`] tells how a camera is, without its frames; [`control`] carries requests to its driver. One camera is five iceoryx2
//! services, `uvcam/v2/<camera>/frames`, `wake`, `mask`, `health` and `control`, with the contract's version in their names, and a page in
//! `/dev/shm` that consumers sleep on. The driver alone creates them. What killed consumers leave behind, it cleans up
//! ([`cleanup_dead_nodes`]). CONTRACT.md, in the package of this crate, has every byte of it.
//!
//! # A driver
//!
//! A [`Publisher`] gives out empty slots ([`Publisher::loan`]) and sends full ones ([`Publisher::publish`]). It counts what is lost
//! ([`Publisher::count_lost`]) and begins epochs ([`Publisher::begin_epoch`]). A [`mask::MaskPublisher`] gives out each mask before the first
//! frame that names it. [`Footing`] tells whether others still find it.

mod cleanup;
mod clock;
mod continuity;
pub mod control;
#[cfg(test)]
mod document;
mod error;
mod footing;
mod frame_service;
mod header;
pub mod health;
mod log;
pub mod mask;
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

/// The library underneath, in the version that a `WaitSet` of a consumer has to be of. Nothing else of it is part of this crate's interface.
pub use iceoryx2;

pub use cleanup::cleanup_dead_nodes;
pub use clock::{monotonic_ns, realtime_ns};
pub use error::{IpcError, IpcErrorKind, LoanError, LoanFailure, SettingError};
pub use footing::Footing;
pub use frame_service::{frame_service_name, wake_service_name};
pub use header::{CONTRACT_VERSION, Flags, FrameHeader, HeaderError, MAGIC};
pub use log::log_to;
pub use mask::Mask;
pub use pixel_format::{PixelFormat, UnknownPixelFormat};
pub use publisher::{Publisher, Slot};
pub use settings::Settings;
pub use subscriber::{Frame, Subscriber};
pub use wakeup::Wakeup;

/// Its example is compiled with the other tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
