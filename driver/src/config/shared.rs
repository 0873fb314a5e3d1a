//! What two cameras must not have in common: a name, a device, or files of a mask.

use std::ops::Range;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::error::Text;
use super::links::resolved;
use super::source::Device;
use super::{CameraConfig, ConfigError, MaskChoice};
use crate::mask_files::MaskFiles;

/// Where the keys are that no two cameras may have in common.
pub(super) struct Places {
    pub(super) name: Range<usize>,
    pub(super) source: Range<usize>,
    pub(super) mask: Range<usize>,
}

/// What the cameras read so far have taken, each with the camera's name.
#[derive(Default)]
pub(super) struct Shared {
    names: Vec<String>,
    devices: Vec<(String, Device)>,
    masks: Vec<(String, Claim)>,
}

impl Shared {
    /// Refuses a camera that takes what another one has.
    pub(super) fn check(
        &mut self,
        text: &Text<'_>,
        camera: &CameraConfig,
        places: &Places,
    ) -> Result<(), ConfigError> {
        let name = &camera.name;
        if self.names.contains(name) {
            let found = format!("\"{name}\" a second time");
            return Err(text.refuse(places.name.clone(), "name", found, "a name of its own for each camera"));
        }
        self.names.push(name.clone());
        if let Some(device) = Device::of(&camera.source) {
            if let Some((other, _)) = self.devices.iter().find(|(_, other)| other.is(&device)) {
                let found = format!("\"{}\" a second time, for \"{name}\" after \"{other}\"", device.written);
                let allowed = "a device of its own for each camera (uvcam list)";
                return Err(text.refuse(places.source.clone(), device.key, found, allowed));
            }
            self.devices.push((name.clone(), device));
        }
        if let MaskChoice::File(path) = &camera.mask {
            let files = Claim::of(path);
            if let Some((other, theirs)) = self.masks.iter().find(|(_, other)| other.meets(&files)) {
                let found = match theirs.in_force == files.in_force || theirs.inode_is_that_of(&files) {
                    true => format!("{} for \"{name}\", which is the mask of \"{other}\"", path.display()),
                    false => format!(
                        "{} for \"{name}\", whose candidate or history is among the files of \"{other}\"",
                        path.display()
                    ),
                };
                let allowed = "a mask file of its own for each camera, such as \"{camera}.png\"";
                return Err(text.refuse(places.mask.clone(), "mask", found, allowed));
            }
            self.masks.push((name.clone(), files));
        }
        Ok(())
    }
}

/// What a camera claims for its mask: all places that are written to.
struct Claim {
    in_force: PathBuf,
    /// Device and inode of the mask in force, where it is there.
    inode: Option<(u64, u64)>,
    /// All names that belong to it, the mask in force included; around a link as well as around what it leads to.
    names: Vec<PathBuf>,
    histories: Vec<PathBuf>,
}

impl Claim {
    fn of(path: &Path) -> Self {
        let in_force = resolved(path);
        let inode = std::fs::metadata(path).ok().map(|file| (file.dev(), file.ino()));
        let mut files = Claim { in_force: in_force.clone(), inode, names: Vec::new(), histories: Vec::new() };
        let link = path.parent().zip(path.file_name()).map(|(folder, name)| resolved(folder).join(name));
        for name in [Some(in_force), link].into_iter().flatten() {
            let around = MaskFiles::around(&name);
            files.names.extend(around.pictures());
            files.names.extend([around.candidate(), name]);
            files.histories.push(around.history_folder());
        }
        files
    }

    fn meets(&self, other: &Claim) -> bool {
        self.inode_is_that_of(other)
            || self.names.iter().any(|name| other.names.contains(name))
            || self.histories.iter().any(|history| other.histories.contains(history))
            || self.lies_in_history_of(other)
            || other.lies_in_history_of(self)
    }

    fn lies_in_history_of(&self, other: &Claim) -> bool {
        other.histories.iter().any(|history| self.names.iter().any(|name| name.starts_with(history)))
    }

    fn inode_is_that_of(&self, other: &Claim) -> bool {
        self.inode.is_some() && self.inode == other.inode
    }
}
