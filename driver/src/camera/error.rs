//! What can go wrong with a camera.

use thiserror::Error;

/// Why a camera cannot be used, or can no longer be used.
#[derive(Debug, Error)]
pub enum CameraError {
    /// No such device is connected.
    #[error(
        "{kind} camera \"{wanted}\" is not connected; found: {found}; check the cable and the serial (uvcam list)"
    )]
    Absent {
        /// The kind of the source.
        kind: &'static str,
        /// The serial, address or folder that was asked for.
        wanted: String,
        /// What was found instead.
        found: String,
    },
    /// The driver was built without the kind of camera.
    #[error(
        "this uvcam was built without cameras of kind \"{kind}\"; build it with the Cargo feature {kind}"
    )]
    NotBuiltIn {
        /// The kind of the source.
        kind: &'static str,
    },
    /// Another device is where the camera was that the driver opened first. Name and mask of the configuration belong to that one.
    #[error(
        "camera {expected} was opened first, and at its place is {found}, which is not flown under its name and mask; \
         connect {expected} again, or restart the driver to fly {found}"
    )]
    Replaced {
        /// Model and serial of the one that was opened first.
        expected: String,
        /// Model and serial of the one that is there now.
        found: String,
    },
    /// The device applied something else than was asked, so its frames would not be what the configuration promises.
    #[error("{setting} = {asked} refused: the camera gives {applied}; {remedy}")]
    Refused {
        /// The key in the configuration, or the GenICam feature.
        setting: &'static str,
        /// The value asked for.
        asked: String,
        /// What the device answered.
        applied: String,
        /// What to do.
        remedy: String,
    },
    /// The device was there and is gone.
    #[error("camera {serial} disconnected while {doing}; check cable and power")]
    Disconnected {
        /// Its serial.
        serial: String,
        /// What the driver was doing.
        doing: &'static str,
    },
    /// The device is there and sends nothing.
    #[error("camera {serial} failed while streaming: no whole frame for {seconds:.1} s; {remedy}")]
    Silent {
        /// Its serial.
        serial: String,
        /// For how long.
        seconds: f64,
        /// What to look at.
        remedy: String,
    },
    /// Every frame of the device lacks a part.
    #[error(
        "camera {serial} failed while streaming: {frames} frames in {seconds:.1} s, none of them whole; {remedy}"
    )]
    Incomplete {
        /// Its serial.
        serial: String,
        /// How many.
        frames: u64,
        /// In which time.
        seconds: f64,
        /// What to look at.
        remedy: String,
    },
    /// The device or its transport failed.
    #[error("camera {serial} failed while {doing}: {cause}")]
    Device {
        /// Its serial.
        serial: String,
        /// What the driver was doing.
        doing: &'static str,
        /// What the device or its library said.
        cause: String,
    },
}

impl CameraError {
    /// Whether trying again cannot help until the configuration changes.
    pub fn is_refusal(&self) -> bool {
        matches!(self, CameraError::Refused { .. })
    }
}
