//! What the driver does with real kernel drivers of cameras. Runs in the virtual machine of `make lab` only: one module a device.
#![allow(clippy::unwrap_used)]

mod usb3_vision;
mod uvc;
mod vivid;
mod without_udevd;
