//! The kinds of cameras. This is the one place that knows all of them.
//!
//! Each kind has its [`CameraSource`] beside it; those that lean on a C library are Cargo features, named as the kind is. Whatever the
//! kind, a camera comes out of here behind the same guard.

use uvcam_shm_ipc::Flags;

#[cfg(feature = "aravis")]
use super::aravis;
use super::guard::Guard;
use super::replay::ReplayFolder;
use super::simulated::Device;
use super::source::{CameraSource, Source};
#[cfg(feature = "v4l2")]
use super::v4l2;
use super::{Camera, CameraError, Identity};

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
pub fn source_of(source: &Source) -> Box<dyn CameraSource> {
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

/// Sends what the cameras' libraries say to the log. To be called once, after the log was started.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::source::{Simulated, V4l2, V4l2Device};

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
            sources().map(|source| source_of(&source).flag()),
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
