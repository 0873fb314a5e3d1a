//! The file as written, and its way to a valid [`Config`].

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::Spanned;
use uvcam_shm_ipc::PixelFormat;

use super::error::Text;
use super::generate::GenerateTable;
use super::realtime::RealtimeTable;
use super::source::SourceTable;
use super::{CameraConfig, Config, ConfigError, Ipc, MaskChoice};
use crate::camera::Settings;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(default)]
    ipc: IpcTable,
    #[serde(default)]
    camera: Vec<CameraTable>,
    uav: Option<Spanned<String>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct IpcTable {
    prefix: Option<Spanned<String>>,
    root_path: Option<Spanned<PathBuf>>,
    max_subscribers: Option<Spanned<usize>>,
    buffer: Option<Spanned<usize>>,
    borrowed: Option<Spanned<usize>>,
    slots: Option<Spanned<usize>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    name: Spanned<String>,
    source: Spanned<SourceTable>,
    width: Spanned<u32>,
    height: Spanned<u32>,
    offset_x: Option<Spanned<u32>>,
    offset_y: Option<Spanned<u32>>,
    binning_horizontal: Option<Spanned<u32>>,
    binning_vertical: Option<Spanned<u32>>,
    pixel_format: Option<Spanned<String>>,
    fps: Spanned<f64>,
    exposure_us: Spanned<f64>,
    gain_db: Option<Spanned<f64>>,
    mask: Option<Spanned<String>>,
    #[serde(default)]
    generate: GenerateTable,
    #[serde(default)]
    realtime: RealtimeTable,
}

/// What may name a camera or a UAV.
const NAME: &str = "1 to 64 letters, digits, \"_\" or \"-\"";
/// Where a mask lies that the configuration does not name: as UVDAR names them.
const MASK: &str = "{uav}_{serial}.png";
pub(super) const EXPOSURE: &str = "1 to 10000000 microseconds";
pub(super) const GAIN: &str = "-40 to 80 decibels";
/// The largest image side that is taken for meant, px.
const LARGEST_SIDE: u32 = 16384;

pub(super) fn parse(text: &str, file: &Path) -> Result<Config, ConfigError> {
    let place = Text { text, file };
    let document: Document = toml::from_str(text).map_err(|error| place.translate(&error))?;
    let reader = Reader(place);
    let uav =
        reader.value_or("uav", document.uav, "uav".into(), NAME, |text| is_name(text) && text.len() <= 64)?;
    let ipc = reader.ipc(document.ipc)?;
    if document.camera.is_empty() {
        return Err(reader.0.refuse(0..0, "camera", "no [[camera]] table".into(), "at least one camera"));
    }
    let mut cameras: Vec<CameraConfig> = Vec::with_capacity(document.camera.len());
    for table in document.camera {
        let name = table.name.clone();
        let camera = reader.camera(table, &uav)?;
        if cameras.iter().any(|other| other.name == camera.name) {
            let found = format!("\"{}\" a second time", camera.name);
            return Err(reader.0.refuse(name.span(), "name", found, "a name of its own for each camera"));
        }
        cameras.push(camera);
    }
    Ok(Config { digest: super::digest(text), ipc, cameras })
}

pub(super) struct Reader<'a>(pub(super) Text<'a>);

impl Reader<'_> {
    /// The value, or a refusal where `valid` says no.
    pub(super) fn value<T: Display>(
        &self,
        key: &str,
        value: Spanned<T>,
        allowed: &str,
        valid: impl FnOnce(&T) -> bool,
    ) -> Result<T, ConfigError> {
        if valid(value.get_ref()) {
            return Ok(value.into_inner());
        }
        let found = value.get_ref().to_string();
        let found = if found.is_empty() { "an empty text".into() } else { found };
        Err(self.0.refuse(value.span(), key, found, allowed))
    }

    /// The value where it is written, the default where not, or a refusal.
    pub(super) fn value_or<T: Display>(
        &self,
        key: &str,
        value: Option<Spanned<T>>,
        default: T,
        allowed: &str,
        valid: impl FnOnce(&T) -> bool,
    ) -> Result<T, ConfigError> {
        value.map_or(Ok(default), |value| self.value(key, value, allowed, valid))
    }

    fn ipc(&self, table: IpcTable) -> Result<Ipc, ConfigError> {
        let default = uvcam_shm_ipc::Settings::default();
        let root_path = match table.root_path {
            None => default.root_path,
            Some(path) if path.get_ref().is_absolute() => path.into_inner(),
            Some(path) => {
                let found = path.get_ref().display().to_string();
                return Err(self.0.refuse(path.span(), "root_path", found, "an absolute path"));
            }
        };
        Ok(Ipc {
            settings: uvcam_shm_ipc::Settings {
                prefix: self.value_or(
                    "prefix",
                    table.prefix,
                    default.prefix,
                    "1 to 32 letters, digits, \"_\" or \"-\"",
                    |text| is_name(text) && text.len() <= 32,
                )?,
                root_path,
                max_subscribers: self.value_or(
                    "max_subscribers",
                    table.max_subscribers,
                    default.max_subscribers,
                    "1 to 64",
                    |n| (1..=64).contains(n),
                )?,
                buffer: self.value_or("buffer", table.buffer, default.buffer, "1 to 256 frames", |n| {
                    (1..=256).contains(n)
                })?,
                borrowed: self.value_or(
                    "borrowed",
                    table.borrowed,
                    default.borrowed,
                    "1 to 64 frames",
                    |n| (1..=64).contains(n),
                )?,
            },
            slots: self.value_or("slots", table.slots, 6, "2 to 64", |n| (2..=64).contains(n))?,
        })
    }

    fn camera(&self, table: CameraTable, uav: &str) -> Result<CameraConfig, ConfigError> {
        let side = |key, value| self.value(key, value, "1 to 16384 px", |n| (1..=LARGEST_SIDE).contains(n));
        let offset = |key, value| self.value_or(key, value, 0, "0 to 16384 px", |n| *n <= LARGEST_SIDE);
        let binning = |key, value| self.value_or(key, value, 1, "1 to 16", |n| (1..=16).contains(n));
        let pixel_format = match table.pixel_format {
            None => PixelFormat::Mono8,
            Some(name) => name.get_ref().parse().map_err(|_| {
                let found = format!("\"{}\"", name.get_ref());
                self.0.refuse(name.span(), "pixel_format", found, "Mono8, Mono10, Mono12 or Mono16")
            })?,
        };
        let settings = Settings {
            width: side("width", table.width)?,
            height: side("height", table.height)?,
            offset_x: offset("offset_x", table.offset_x)?,
            offset_y: offset("offset_y", table.offset_y)?,
            binning_horizontal: binning("binning_horizontal", table.binning_horizontal)?,
            binning_vertical: binning("binning_vertical", table.binning_vertical)?,
            pixel_format,
            fps: self.value("fps", table.fps, "0.1 to 10000 frames a second", |fps| {
                (0.1..=10_000.0).contains(fps)
            })?,
            exposure_us: self.value(
                "exposure_us",
                table.exposure_us,
                "1 to 10000000 microseconds",
                |us| (1.0..=1e7).contains(us),
            )?,
            gain_db: self.value_or("gain_db", table.gain_db, 0.0, GAIN, |db| (-40.0..=80.0).contains(db))?,
        };
        let name = self.value("name", table.name, NAME, |text| is_name(text) && text.len() <= 64)?;
        let source = self.source(table.source)?;
        let allowed = "a PNG file, or \"none\" to fly without a mask";
        let mask = self.value_or("mask", table.mask, MASK.into(), allowed, |text| !text.is_empty())?;
        let mask = match mask.as_str() {
            "none" => MaskChoice::None,
            template => {
                let file = template
                    .replace("{uav}", uav)
                    .replace("{camera}", &name)
                    .replace("{serial}", source.serial());
                MaskChoice::File(self.resolve(file.as_ref()))
            }
        };
        let generate = self.generate(table.generate, &settings)?;
        let realtime = table.realtime.read(self)?;
        Ok(CameraConfig { name, source, settings, mask, generate, realtime })
    }

    /// A relative path starts at the configuration's folder.
    pub(super) fn resolve(&self, path: &Path) -> PathBuf {
        self.0.file.parent().map_or_else(|| path.to_path_buf(), |folder| folder.join(path))
    }
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-')
}
