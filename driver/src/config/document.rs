//! The file as written, and its way to a valid [`Config`].

use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, Deserializer};
use uvcam_shm_ipc::control::{EXPOSURE_US, GAIN_DB};
use uvcam_shm_ipc::{PixelFormat, SettingError};

use super::error::Text;
use super::generate::GenerateTable;
use super::keys::{TOP, Table, keys_of, suggestion};
use super::reader::{Reader, either};
use super::realtime::RealtimeTable;
use super::shared::{Places, Shared};
use super::source::SourceTable;
use super::{CameraConfig, Config, ConfigError, Ipc, MaskChoice, MaskMode, Source};
use crate::camera::Settings;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(default)]
    ipc: IpcTable,
    #[serde(default)]
    camera: Vec<CameraTable>,
    uav: Option<Spanned<String>>,
    process_per_camera: Option<bool>,
    process_memory_mb: Option<Spanned<u64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct IpcTable {
    prefix: Option<Spanned<String>>,
    root_path: Option<Spanned<String>>,
    max_subscribers: Option<Spanned<u64>>,
    buffer: Option<Spanned<u64>>,
    borrowed: Option<Spanned<u64>>,
    slots: Option<Spanned<u64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    name: Spanned<String>,
    source: Spanned<SourceTable>,
    width: Spanned<u64>,
    height: Spanned<u64>,
    offset_x: Option<Spanned<u64>>,
    offset_y: Option<Spanned<u64>>,
    binning_horizontal: Option<Spanned<u64>>,
    binning_vertical: Option<Spanned<u64>>,
    pixel_format: Option<Spanned<String>>,
    fps: Spanned<f64>,
    exposure_us: Spanned<f64>,
    gain_db: Option<Spanned<f64>>,
    mask: Option<Spanned<String>>,
    mask_mode: Option<Spanned<String>>,
    #[serde(default)]
    generate: GenerateTable,
    #[serde(default)]
    realtime: RealtimeTable,
}

/// The tables of a configuration, with the keys that are read of each.
pub(super) fn tables() -> [Table; 6] {
    [
        (TOP, keys_of::<Document>()),
        ("[ipc]", keys_of::<IpcTable>()),
        ("[[camera]]", keys_of::<CameraTable>()),
        ("source", keys_of::<SourceTable>()),
        ("[camera.generate]", keys_of::<GenerateTable>()),
        ("[camera.realtime]", keys_of::<RealtimeTable>()),
    ]
}

/// What may name a camera or a UAV.
const NAME: &str = "1 to 64 letters, digits, \"_\" or \"-\" (ASCII)";
/// Where a mask lies that the configuration does not name: as UVDAR names them.
const MASK: &str = "{uav}_{serial}.png";
/// Twice what it takes to generate the mask of the largest frames that can have one (32 MB of pixels).
const PROCESS_MEMORY_MB: u64 = 1024;
/// The largest image side that is taken for meant, px.
const LARGEST_SIDE: u64 = 16384;

pub(super) fn parse(text: &str, file: &Path) -> Result<Config, ConfigError> {
    let place = Text { text, file };
    let reader = Reader(place);
    let parsed = DeTable::parse(text).map_err(|error| place.not_toml(&error))?;
    reader.check_headings(parsed.get_ref())?;
    reader.check_sources(parsed.get_ref())?;
    let document: Document = serde_path_to_error::deserialize(Deserializer::from(parsed))
        .map_err(|error| place.not_ours(error.inner(), error.path(), &tables()))?;
    let uav =
        reader.value_or("uav", document.uav, "uav".into(), NAME, |text| is_name(text) && text.len() <= 64)?;
    let process_memory_mb = document.process_memory_mb.map_or(Ok(PROCESS_MEMORY_MB), |mb| {
        reader.whole("process_memory_mb", mb, "128 to 1048576 MB", 128..=1 << 20)
    })?;
    let ipc = reader.ipc(document.ipc)?;
    if document.camera.is_empty() {
        return Err(reader.0.refuse(0..0, "camera", "no [[camera]] table".into(), "at least one camera"));
    }
    let mut cameras = Vec::with_capacity(document.camera.len());
    let mut shared = Shared::default();
    for table in document.camera {
        let places = table.places();
        let camera = reader.camera(table, &uav)?;
        shared.check(&reader.0, &camera, &places)?;
        cameras.push(camera);
    }
    Ok(Config {
        digest: super::digest(text),
        text: text.to_owned(),
        process_per_camera: document.process_per_camera.unwrap_or(true),
        process_memory_bytes: process_memory_mb << 20,
        ipc,
        cameras,
    })
}

impl CameraTable {
    fn places(&self) -> Places {
        let (name, source) = (self.name.span(), self.source.get_ref().place());
        let mask = self.mask.as_ref().map_or(name.clone(), Spanned::span);
        Places { name, source, mask }
    }
}

impl Reader<'_> {
    /// One `[camera]` is no list of cameras, and nothing else is one: a list would be taken for a table, its elements for keys.
    fn check_headings(&self, document: &DeTable<'_>) -> Result<(), ConfigError> {
        self.check_single(document, "ipc", "write [ipc]")?;
        let Some((key, cameras)) = document.get_key_value("camera") else { return Ok(()) };
        let mistyped = |found: &str| {
            let write = "write [[camera]] above each camera".into();
            Err(self.0.mistyped(key.span().start, "camera", found.into(), write))
        };
        let Some(cameras) = cameras.get_ref().as_array() else { return mistyped("a single table") };
        for camera in cameras.iter() {
            let Some(camera) = camera.get_ref().as_table() else { return mistyped("a list without tables") };
            self.check_single(camera, "source", "write source = { ... }")?;
            self.check_single(camera, "generate", "write [camera.generate]")?;
            self.check_single(camera, "realtime", "write [camera.realtime]")?;
        }
        Ok(())
    }

    fn check_single(&self, table: &DeTable<'_>, key: &str, write: &str) -> Result<(), ConfigError> {
        match table.get_key_value(key) {
            Some((place, value)) if value.get_ref().is_array() => {
                Err(self.0.mistyped(place.span().start, key, "a list".into(), write.into()))
            }
            _ => Ok(()),
        }
    }

    fn ipc(&self, table: IpcTable) -> Result<Ipc, ConfigError> {
        let default = uvcam_shm_ipc::Settings::default();
        let places = [
            ("prefix", table.prefix.as_ref().map(Spanned::span)),
            ("root_path", table.root_path.as_ref().map(Spanned::span)),
            ("max_subscribers", table.max_subscribers.as_ref().map(Spanned::span)),
            ("buffer", table.buffer.as_ref().map(Spanned::span)),
            ("borrowed", table.borrowed.as_ref().map(Spanned::span)),
        ];
        let number = |value: Option<Spanned<u64>>, default| {
            value.map_or(default, |value| usize::try_from(value.into_inner()).unwrap_or(usize::MAX))
        };
        let root_path = table.root_path.map(|path| self.path("root_path", path, "an absolute path"));
        let mut settings = uvcam_shm_ipc::Settings::new(
            table.prefix.map_or(default.prefix, Spanned::into_inner),
            root_path.transpose()?.map_or(default.root_path, PathBuf::from),
        );
        settings.max_subscribers = number(table.max_subscribers, default.max_subscribers);
        settings.buffer = number(table.buffer, default.buffer);
        settings.borrowed = number(table.borrowed, default.borrowed);
        if let Err(SettingError { key, found, allowed, .. }) = settings.validate() {
            // Two keys can be too much together where only one of them is written.
            let place = places.iter().find(|(name, place)| *name == key && place.is_some());
            let place = place.or_else(|| places.iter().find(|(_, place)| place.is_some()));
            let span = place.and_then(|(_, place)| place.clone()).unwrap_or_default();
            return Err(self.0.refuse(span, key, found, allowed));
        }
        let slots = table.slots.map(|slots| self.whole("slots", slots, "2 to 64", 2..=64));
        Ok(Ipc { settings, slots: slots.transpose()?.unwrap_or(6) })
    }

    fn camera(&self, table: CameraTable, uav: &str) -> Result<CameraConfig, ConfigError> {
        let side = |key, value| self.whole::<u32>(key, value, "1 to 16384 px", 1..=LARGEST_SIDE);
        let offset = |key, value: Option<_>| match value {
            Some(value) => self.whole(key, value, "0 to 16384 px", 0..=LARGEST_SIDE),
            None => Ok(0),
        };
        let binning = |key, value: Option<_>| match value {
            Some(value) => self.whole(key, value, "1 to 16", 1..=16),
            None => Ok(1),
        };
        let pixel_format = match table.pixel_format {
            None => PixelFormat::Mono8,
            Some(name) => name.get_ref().parse().map_err(|_| {
                let known = PixelFormat::ALL.map(PixelFormat::name);
                let found = format!("\"{}\"{}", name.get_ref(), suggestion(name.get_ref(), &known));
                self.0.refuse(name.span(), "pixel_format", found, &either(&known))
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
            exposure_us: self.within("exposure_us", table.exposure_us, &EXPOSURE_US)?,
            gain_db: table.gain_db.map_or(Ok(0.0), |gain| self.within("gain_db", gain, &GAIN_DB))?,
        };
        let name = self.value("name", table.name, NAME, |text| is_name(text) && text.len() <= 64)?;
        let source = self.source(table.source)?;
        let mask = match table.mask {
            Some(mask) => self.mask(mask, uav, &name, &source)?,
            None => self.mask_file(MASK, uav, &name, &source),
        };
        let mask_mode = self.mask_mode(table.mask_mode, &mask)?;
        let generate = self.generate(table.generate, &settings)?;
        let realtime = table.realtime.read(self)?;
        Ok(CameraConfig { name, source, settings, mask, mask_mode, generate, realtime })
    }

    fn mask(
        &self,
        mask: Spanned<String>,
        uav: &str,
        name: &str,
        source: &Source,
    ) -> Result<MaskChoice, ConfigError> {
        let span = mask.span();
        let template = self.path("mask", mask, "a PNG file, or \"none\" to fly without a mask")?;
        let mistyped = |write: String| self.0.mistyped(span.start, "mask", format!("{template:?}"), write);
        if template == "none" {
            return Ok(MaskChoice::None);
        }
        if ["none", "no", "off", "false", "null"].contains(&template.trim().to_lowercase().as_str()) {
            let file = format!("\"./{}\" for a file of this name", template.trim());
            return Err(mistyped(format!("write \"none\" to fly without a mask, {file}")));
        }
        let rest = template.replace("{uav}", "").replace("{camera}", "").replace("{serial}", "");
        if rest.contains('{') && rest.contains('}') {
            return Err(mistyped("write {uav}, {serial} or {camera}: only these stand for names".into()));
        }
        Ok(self.mask_file(&template, uav, name, source))
    }

    fn mask_mode(&self, mode: Option<Spanned<String>>, mask: &MaskChoice) -> Result<MaskMode, ConfigError> {
        let Some(mode) = mode else { return Ok(MaskMode::default()) };
        let word = mode.get_ref().as_str();
        match (word, mask) {
            ("blank", _) => Ok(MaskMode::Blank),
            ("attach", MaskChoice::File(_)) => Ok(MaskMode::Attach),
            ("attach", MaskChoice::None) => {
                let allowed = "\"blank\" where mask is \"none\": there is none to attach";
                Err(self.0.refuse(mode.span(), "mask_mode", format!("\"{word}\""), allowed))
            }
            _ => {
                let found = format!("\"{word}\"{}", suggestion(word, &["blank", "attach"]));
                Err(self.0.refuse(mode.span(), "mask_mode", found, "\"blank\" or \"attach\""))
            }
        }
    }

    fn mask_file(&self, template: &str, uav: &str, name: &str, source: &Source) -> MaskChoice {
        let file =
            template.replace("{uav}", uav).replace("{camera}", name).replace("{serial}", source.serial());
        MaskChoice::File(self.resolve(file.as_ref()))
    }
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-')
}
