//! `source`, whose keys depend on its kind.

use std::ops::Range;
use std::path::PathBuf;

use serde::Deserialize;
use toml::Spanned;
use toml::de::DeTable;
use uvcam_shm_ipc::control::EXPOSURE_US;

use super::faults::FaultTable;
use super::keys::{nearest, suggestion};
use super::links::resolved;
use super::reader::{Reader, either};
use super::{ConfigError, Simulated, Source, V4l2, V4l2Device, V4l2Memory};
use crate::camera::kinds::is_built_in;

/// The kinds of `source`, and their keys beside `kind`.
const KINDS: [(&str, &[&str]); 4] = [
    ("aravis", &["serial"]),
    ("replay", &["path"]),
    ("simulated", &["serial", "still", "readout_us", "faults"]),
    ("v4l2", &["path", "serial", "memory", "gain_step_db", "fixed_exposure_us"]),
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SourceTable {
    kind: Spanned<String>,
    serial: Option<Spanned<String>>,
    path: Option<Spanned<String>>,
    still: Option<Spanned<bool>>,
    readout_us: Option<Spanned<f64>>,
    faults: Option<Spanned<Vec<FaultTable>>>,
    memory: Option<Spanned<String>>,
    gain_step_db: Option<Spanned<f64>>,
    fixed_exposure_us: Option<Spanned<f64>>,
}

impl SourceTable {
    /// Where it says which device it is.
    pub(super) fn place(&self) -> Range<usize> {
        let serial = self.serial.as_ref().map(Spanned::span);
        let path = self.path.as_ref().map(Spanned::span);
        serial.or(path).unwrap_or_else(|| self.kind.span())
    }
}

impl Reader<'_> {
    /// Refuses kinds that there are not, and keys that are not of the kind: they would be ignored in silence. What else is wrong is told
    /// later.
    pub(super) fn check_sources(&self, document: &DeTable<'_>) -> Result<(), ConfigError> {
        let cameras = document.get("camera").and_then(|cameras| cameras.get_ref().as_array());
        let tables = cameras.into_iter().flat_map(|cameras| cameras.iter());
        for camera in tables.filter_map(|camera| camera.get_ref().as_table()) {
            if let Some(source) = camera.get("source").and_then(|source| source.get_ref().as_table()) {
                self.check_source(source)?;
            }
        }
        Ok(())
    }

    fn check_source(&self, source: &DeTable<'_>) -> Result<(), ConfigError> {
        let Some((_, kind)) = source.get_key_value("kind") else { return self.without_kind(source) };
        let (place, Some(kind)) = (kind.span(), kind.get_ref().as_str()) else { return Ok(()) };
        let Some((kind, known)) = KINDS.iter().find(|(name, _)| *name == kind) else {
            let found = format!("\"{kind}\"{}", suggestion(kind, &KINDS.map(|(name, _)| name)));
            return Err(self.0.refuse(place, "kind", found, &kinds()));
        };
        self.check_built_in(place, kind, is_built_in(kind))?;
        let strange =
            source.keys().filter(|key| key.get_ref() != "kind" && !known.contains(&key.get_ref().as_ref()));
        let Some(key) = strange.min_by_key(|key| key.span().start) else { return Ok(()) };
        let (place, key) = (key.span(), key.get_ref());
        let owners: Vec<&str> =
            KINDS.iter().filter(|(_, keys)| keys.contains(&key.as_ref())).map(|(name, _)| *name).collect();
        let keys = known.join(", ");
        Err(match owners.is_empty() {
            true => {
                let found = format!("an unknown key{}", suggestion(key, known));
                self.0.refuse(place, key, found, &format!("{keys} in a source of kind \"{kind}\""))
            }
            false => {
                let owners = owners.join("\" or \"");
                let allowed = format!(
                    "no such key in a source of kind \"{kind}\" but {keys}; it is one of kind \"{owners}\""
                );
                self.0.refuse(place, key, "a value".into(), &allowed)
            }
        })
    }

    /// What this program cannot open is refused before it flies.
    pub(super) fn check_built_in(
        &self,
        place: Range<usize>,
        kind: &'static str,
        is_built_in: bool,
    ) -> Result<(), ConfigError> {
        match is_built_in {
            true => Ok(()),
            false => {
                Err(ConfigError::NotBuiltIn { place: self.0.place(place.start), kind, built_in: kinds() })
            }
        }
    }

    /// Another word may stand for it.
    fn without_kind(&self, source: &DeTable<'_>) -> Result<(), ConfigError> {
        match source.keys().find(|key| nearest(key.get_ref(), &["kind"]).is_some()) {
            Some(key) => {
                let found = format!("an unknown key{}", suggestion(key.get_ref(), &["kind"]));
                Err(self.0.refuse(key.span(), key.get_ref(), found, &format!("kind = {}", kinds())))
            }
            None => Ok(()),
        }
    }

    pub(super) fn source(&self, table: Spanned<SourceTable>) -> Result<Source, ConfigError> {
        let (span, table) = (table.span(), table.into_inner());
        match table.kind.get_ref().as_str() {
            "aravis" => Ok(Source::Aravis { serial: self.serial(table.serial, span)? }),
            "replay" => {
                let path = table.path.ok_or_else(|| self.missing("path", span))?;
                Ok(Source::Replay {
                    path: self.resolve(self.path("path", path, "a folder of PNG files")?.as_ref()),
                })
            }
            "v4l2" => self.v4l2(table, span).map(Source::V4l2),
            // `check_sources` has refused all others.
            _ => self.simulated(table, span).map(Source::Simulated),
        }
    }

    fn simulated(&self, table: SourceTable, span: Range<usize>) -> Result<Simulated, ConfigError> {
        Ok(Simulated {
            serial: self.serial(table.serial, span)?,
            still: table.still.is_some_and(Spanned::into_inner),
            readout_us: self.value_or(
                "readout_us",
                table.readout_us,
                0.0,
                "0 to 10000000 microseconds",
                |us| (0.0..=1e7).contains(us),
            )?,
            faults: self.faults(table.faults.map(Spanned::into_inner).unwrap_or_default())?,
        })
    }

    fn v4l2(&self, table: SourceTable, span: Range<usize>) -> Result<V4l2, ConfigError> {
        let device = match (table.path, table.serial) {
            (Some(path), None) => {
                let path = self.path("path", path, "a device node, or a link to one")?;
                V4l2Device::Path(self.resolve(path.as_ref()))
            }
            (None, Some(serial)) => V4l2Device::Serial(self.serial(Some(serial), span)?),
            (Some(_), Some(_)) => {
                let found = "both path and serial".into();
                return Err(self.0.refuse(span, "source", found, "one of them"));
            }
            (None, None) => return Err(self.missing("path or serial", span)),
        };
        let memory = match table.memory {
            None => None,
            Some(name) => Some(match name.get_ref().as_str() {
                "userptr" => V4l2Memory::UserPointer,
                "mmap" => V4l2Memory::Mapped,
                other => {
                    let (found, allowed) = (format!("\"{other}\""), "\"userptr\" or \"mmap\"");
                    return Err(self.0.refuse(name.span(), "memory", found, allowed));
                }
            }),
        };
        let gain_step_db = table.gain_step_db.map(|step| {
            self.value("gain_step_db", step, "0.001 to 20 decibels", |db| (0.001..=20.0).contains(db))
        });
        let fixed_exposure_us =
            table.fixed_exposure_us.map(|time| self.within("fixed_exposure_us", time, &EXPOSURE_US));
        Ok(V4l2 {
            device,
            memory,
            gain_step_db: gain_step_db.transpose()?,
            fixed_exposure_us: fixed_exposure_us.transpose()?,
        })
    }

    /// Without the spaces around it: some devices pad theirs, and are compared without them.
    fn serial(&self, serial: Option<Spanned<String>>, span: Range<usize>) -> Result<String, ConfigError> {
        let serial = serial.ok_or_else(|| self.missing("serial", span))?;
        let serial = self.value("serial", serial, "the camera's serial", |text| !text.trim().is_empty())?;
        Ok(serial.trim().to_owned())
    }

    fn missing(&self, key: &str, span: Range<usize>) -> ConfigError {
        self.0.refuse(span, key, "nothing".into(), "this key must be written")
    }
}

/// A device that one camera alone can have.
pub(super) struct Device {
    /// The key that names it, and its value.
    pub(super) key: &'static str,
    pub(super) written: String,
    named_by: NamedBy,
}

#[derive(PartialEq)]
enum NamedBy {
    /// Serial, device id or address of a USB3 Vision or GigE Vision camera.
    Vision(String),
    /// Serial of a camera of the kernel.
    Kernel(String),
    /// Node of a camera of the kernel, links followed.
    Node(PathBuf),
}

impl Device {
    pub(super) fn of(source: &Source) -> Option<Self> {
        let (key, written, named_by) = match source {
            Source::Aravis { serial } => ("serial", serial.clone(), NamedBy::Vision(serial.clone())),
            Source::V4l2(V4l2 { device: V4l2Device::Serial(serial), .. }) => {
                ("serial", serial.clone(), NamedBy::Kernel(serial.clone()))
            }
            Source::V4l2(V4l2 { device: V4l2Device::Path(path), .. }) => {
                ("path", path.display().to_string(), NamedBy::Node(resolved(path)))
            }
            Source::Replay { .. } | Source::Simulated(_) => return None,
        };
        Some(Device { key, written, named_by })
    }

    pub(super) fn is(&self, other: &Device) -> bool {
        match (&self.named_by, &other.named_by) {
            (NamedBy::Vision(one), NamedBy::Vision(other)) => {
                one == other || is_device_id_of(one, other) || is_device_id_of(other, one)
            }
            (one, other) => one == other,
        }
    }
}

/// Whether `id` is `Vendor-Model-Serial` of this serial.
fn is_device_id_of(id: &str, serial: &str) -> bool {
    let model = id.strip_suffix(serial).and_then(|rest| rest.strip_suffix('-'));
    model.is_some_and(|model| model.contains('-'))
}

/// The kinds that this program has, for a message.
fn kinds() -> String {
    let built_in = KINDS.iter().filter(|(kind, _)| is_built_in(kind));
    let names: Vec<String> = built_in.map(|(kind, _)| format!("\"{kind}\"")).collect();
    either(&names)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::Config;
    use super::super::error::Text;
    use super::*;
    use crate::camera::kinds;

    const FILE: &str = "/etc/uvcam/uvcam.toml";

    fn text(kind: &str) -> String {
        let which = if kind == "replay" { "path" } else { "serial" };
        format!(
            "[[camera]]\nname = \"left\"\nsource = {{ kind = \"{kind}\", {which} = \"42\" }}\nwidth = 64\nheight = 48\nfps = 50\n\
             exposure_us = 1000\nmask = \"none\"\n"
        )
    }

    #[test]
    fn a_kind_that_is_not_built_in_is_refused_with_its_line() {
        let text = text("aravis");
        let reader = Reader(Text { text: &text, file: Path::new(FILE) });
        let place = text.find("\"aravis\"").unwrap();
        reader.check_built_in(place..place, "aravis", true).unwrap();
        let message = reader.check_built_in(place..place, "aravis", false).unwrap_err().to_string();
        let start = "/etc/uvcam/uvcam.toml:3: kind: found \"aravis\", and this uvcam was built without it; install one that has it (build \
                     with the Cargo feature aravis), or write a kind that this one has: ";
        assert_eq!(message, format!("{start}{}", kinds()));
    }

    #[test]
    fn exactly_the_kinds_that_are_built_in_are_taken() {
        for (kind, is_built_in) in kinds::KINDS {
            let outcome = Config::parse(&text(kind), Path::new(FILE));
            assert_eq!(outcome.is_ok(), is_built_in, "{kind}: {outcome:?}");
            assert_eq!(kinds().contains(kind), is_built_in, "{kind}");
            assert_eq!(matches!(outcome, Err(ConfigError::NotBuiltIn { .. })), !is_built_in, "{kind}");
        }
    }
}
