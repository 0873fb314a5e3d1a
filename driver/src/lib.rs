//! The driver of uvcam: cameras, the way of a frame, and the commands.
//!
//! A frame is written by a [`camera`] into a slot of shared memory, loses its masked runs there and is sent ([`frame_path`]).
//! One thread a camera walks this way under the eyes of [`supervise`]; the [`engine`] runs them, in a
//! process each (`processes`), or all in one. The commands ([`cmd`]) start it, or
//! look at it from outside as any consumer does.

pub mod args;
mod back_off;
pub mod camera;
mod causes;
pub mod clock;
pub mod cmd;
pub mod config;
pub mod control;
pub mod counters;
pub mod doctor;
pub mod engine;
pub mod error;
pub mod exit;
pub mod frame_path;
pub mod generate;
pub mod health;
pub mod latency;
pub mod log;
pub mod mask;
pub mod mask_files;
pub mod mask_store;
mod memory;
mod processes;
pub mod realtime;
mod service_manager;
mod signals;
pub mod supervise;
mod thread;
mod told;
