//! libuvcam: the frame contract of uvcam for C and C++.
//!
//! Thin: each function looks up a handle, calls `uvcam-shm-ipc`, and turns what comes back into a status. `include/uvcam.h` is generated
//! from these files, so what is written here as documentation is what C programs read; a test compares them.
//!
//! Laws of what C hands over, which its header asks for:
//! 1. A text is NULL, or readable up to its zero byte, as long as the call lasts.
//! 2. A structure to be read is NULL, or readable and aligned, as long as the call lasts.
//! 3. A place to be written is NULL, or writable and aligned, and nobody else uses it, as long as the call lasts.
//!
//! Handles are numbers and are never followed ([`handle`]). What is handed out as a pointer lives until its frame or mask is released.

mod argument;
mod error;
mod frame;
mod handle;
mod health;
mod mask;
mod settings;
mod subscriber;
