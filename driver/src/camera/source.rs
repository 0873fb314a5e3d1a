//! Where cameras come from: a source is what a configuration names, and opens its camera as often as needed.
//!
//! This is the one place that knows all kinds of cameras. Each has its [`CameraSource`] beside it; the kinds that lean on a C library are
//! Cargo features, named as the kind is. Whatever the kind, a camera comes out of here behind the same guard.

use std::path::PathBuf;

use uvcam_shm_ipc::Flags;

#[cfg(feature = "aravis")]
use super::aravis;
use super::guard::Guard;
use super::replay::ReplayFolder;
use super::simulated::Device;
#[cfg(feature = "v4l2")]
use super::v4l2;
use super::{Camera, CameraError, Identity};

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

/// The kinds of cameras, and whether this program was built with them.
pub const KINDS: [(&str, bool); 4] = [
    ("aravis", cfg!(feature = "aravis")),
    ("replay", true),
    ("simulated", true),
    ("v4l2", cfg!(feature = "v4l2")),
];

/// Whether this program was built with cameras of this kind.
pub fn is_built_in(kind: &str) -> bool {
    KINDS.contains(&(kind, true))
}

/// What opens the camera that `source` describes. Its cameras stand behind the guard.
pub fn of(source: &Source) -> Box<dyn CameraSource> {
    Box::new(Guarded(built_in(source).unwrap_or_else(|| Box::new(NotBuiltIn(source.kind())))))
}

fn built_in(source: &Source) -> Option<Box<dyn CameraSource>> {
    Some(match source {
        #[cfg(feature = "aravis")]
        Source::Aravis { serial } => Box::new(aravis::Finder::new(serial)),
        Source::Replay { path } => Box::new(ReplayFolder(path.clone())),
        Source::Simulated(script) => Box::new(Device::new(script.clone())),
        #[cfg(feature = "v4l2")]
        Source::V4l2(v4l2) => Box::new(v4l2.clone()),
        #[cfg(not(all(feature = "aravis", feature = "v4l2")))]
        _ => return None,
    })
}

/// All connected cameras that the access rights let the driver open, of the kinds that are devices. Takes about a second.
pub fn list() -> Vec<Identity> {
    let lists: &[fn() -> Vec<Identity>] = &[
        #[cfg(feature = "aravis")]
        aravis::list,
        #[cfg(feature = "v4l2")]
        v4l2::list,
    ];
    lists.iter().flat_map(|list| list()).collect()
}

/// Leads what the libraries behind the cameras say into the log. To be called once, when the log is there.
pub fn log_libraries() {
    #[cfg(feature = "aravis")]
    aravis::log_library();
}

/// Puts the guard around each camera.
struct Guarded(Box<dyn CameraSource>);

impl CameraSource for Guarded {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Ok(Box::new(Guard::new(self.0.open()?)))
    }

    fn flag(&self) -> Flags {
        self.0.flag()
    }
}

/// A kind that this program was built without. A configuration that names one is refused before.
struct NotBuiltIn(&'static str);

impl CameraSource for NotBuiltIn {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Err(CameraError::NotBuiltIn { kind: self.0 })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sources() -> [Source; 4] {
        [
            Source::Aravis { serial: "42".into() },
            Source::Replay { path: "/flights/42".into() },
            Source::Simulated(Simulated {
                serial: "42".into(),
                still: true,
                readout_us: 0.0,
                faults: vec![],
            }),
            Source::V4l2(V4l2 {
                device: V4l2Device::Path("/dev/v4l/by-id/42".into()),
                memory: None,
                gain_step_db: None,
                fixed_exposure_us: None,
            }),
        ]
    }

    #[test]
    fn every_kind_has_its_name_and_its_source_where_it_is_built_in() {
        for (source, (kind, is_built_in)) in sources().iter().zip(KINDS) {
            assert_eq!(source.kind(), kind);
            assert_eq!(source.serial(), "42");
            assert_eq!(
                (super::is_built_in(kind), built_in(source).is_some()),
                (is_built_in, is_built_in),
                "{kind}"
            );
        }
        assert!(!super::is_built_in("uvc"));
    }

    #[test]
    fn frames_of_no_real_camera_say_so() {
        assert_eq!(
            sources().map(|source| of(&source).flag()),
            [Flags::NONE, Flags::REPLAYED, Flags::SIMULATED, Flags::NONE]
        );
    }

    #[test]
    fn a_kind_that_is_not_built_in_is_told() {
        let error = Guarded(Box::new(NotBuiltIn("aravis"))).open().err().unwrap();
        assert_eq!(
            error.to_string(),
            "this uvcam was built without cameras of kind \"aravis\"; build it with the Cargo feature aravis"
        );
    }
}
