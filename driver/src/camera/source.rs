//! Where cameras come from: what a configuration names, and what opens the camera of that name as often as needed.

use std::path::PathBuf;

use uvcam_shm_ipc::Flags;

use super::{Camera, CameraError};

/// Opens one camera, again and again.
pub trait CameraSource: Send {
    /// Opens the camera. It is to be dropped before it is opened again.
    ///
    /// # Errors
    /// [`CameraError::Absent`] where it is not connected, which is asked ten times a second; [`CameraError::Device`] where it may not be
    /// opened; [`CameraError::Refused`] where more than one camera is meant.
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError>;

    /// What headers say of its frames.
    fn flag(&self) -> Flags {
        Flags::NONE
    }
}

/// `source`: where the frames of a camera come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A USB3 Vision or GigE Vision camera.
    Aravis {
        /// Serial, device id or IP address, without spaces around it.
        serial: String,
    },
    /// A folder of PNG files.
    Replay {
        /// The folder, with the configuration's folder resolved.
        path: PathBuf,
    },
    /// A rendered scene.
    Simulated(Simulated),
    /// A camera of one of the kernel's video drivers.
    V4l2(V4l2),
}

impl Source {
    /// The `kind` that a configuration names.
    pub fn kind(&self) -> &'static str {
        match self {
            Source::Aravis { .. } => "aravis",
            Source::Replay { .. } => "replay",
            Source::Simulated(_) => "simulated",
            Source::V4l2(_) => "v4l2",
        }
    }

    /// What tells this camera from others: its serial, or the name of its folder or node.
    pub fn serial(&self) -> &str {
        match self {
            Source::Aravis { serial } | Source::Simulated(Simulated { serial, .. }) => serial,
            Source::V4l2(V4l2 { device: V4l2Device::Serial(serial), .. }) => serial,
            Source::V4l2(V4l2 { device: V4l2Device::Path(path), .. }) | Source::Replay { path } => {
                path.file_name().and_then(|name| name.to_str()).unwrap_or("unnamed")
            }
        }
    }
}

/// The keys of a camera of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct V4l2 {
    /// Which one.
    pub device: V4l2Device,
    /// The only memory of frames to be used; without it, whatever saves a copy.
    pub memory: Option<V4l2Memory>,
    /// Decibels that one step of the device's gain adds; V4L2 does not tell.
    pub gain_step_db: Option<f64>,
    /// The exposure time of a device that has no control of it, microseconds.
    pub fixed_exposure_us: Option<f64>,
}

/// How a camera of the kernel is found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum V4l2Device {
    /// By its node, or a link to it.
    Path(PathBuf),
    /// By its serial, or the place where it is connected; without spaces around it.
    Serial(String),
}

/// Whose memory a camera of the kernel writes frames into (V4L2_MEMORY_*).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum V4l2Memory {
    /// The slots themselves (V4L2_MEMORY_USERPTR).
    UserPointer,
    /// The kernel's, from which a frame is copied (V4L2_MEMORY_MMAP).
    Mapped,
}

/// The simulated camera's own keys.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// The serial that it reports.
    pub serial: String,
    /// Every frame the same, without noise.
    pub still: bool,
    /// Time from the end of an exposure to the next one, microseconds.
    pub readout_us: f64,
    /// What goes wrong, in the order of frames.
    pub faults: Vec<Fault>,
}

/// One scripted fault of the simulated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// The frame, counted from the driver's start, at which it begins.
    pub at_frame: u64,
    /// What goes wrong.
    pub kind: FaultKind,
}

/// What goes wrong in a simulated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// Frames are exposed and never delivered.
    Lost {
        /// How many.
        count: u64,
    },
    /// Frames arrive with a part missing.
    Incomplete {
        /// How many.
        count: u64,
    },
    /// The camera falls silent without an error.
    Freeze {
        /// For how long.
        seconds: f64,
    },
    /// The camera is gone.
    Unplug {
        /// For how long.
        seconds: f64,
    },
    /// The camera is gone for an instant, and then reads back another exposure than was set.
    WrongSettings {
        /// How many times.
        count: u64,
    },
    /// A call into the camera's library does not return.
    Hang {
        /// For how long.
        seconds: f64,
    },
    /// The camera's thread panics.
    Panic,
    /// The camera's library takes memory and keeps it.
    Leak {
        /// How much, in units of 2^20 bytes.
        megabytes: u64,
    },
}
