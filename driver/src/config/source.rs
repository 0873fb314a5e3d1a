//! `source`, whose keys depend on its kind.

use std::ops::Range;
use std::path::PathBuf;

use serde::Deserialize;
use toml::Spanned;

use super::document::{EXPOSURE, Reader};
use super::faults::FaultTable;
use super::{ConfigError, Simulated, Source, V4l2, V4l2Device, V4l2Memory};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SourceTable {
    kind: Spanned<String>,
    serial: Option<Spanned<String>>,
    path: Option<Spanned<PathBuf>>,
    still: Option<Spanned<bool>>,
    readout_us: Option<Spanned<f64>>,
    faults: Option<Spanned<Vec<FaultTable>>>,
    memory: Option<Spanned<String>>,
    gain_step_db: Option<Spanned<f64>>,
    fixed_exposure_us: Option<Spanned<f64>>,
}

impl SourceTable {
    /// The keys that are written, besides the kind, and where.
    fn written(&self) -> impl Iterator<Item = (&'static str, Range<usize>)> {
        let keys = [
            ("serial", self.serial.as_ref().map(Spanned::span)),
            ("path", self.path.as_ref().map(Spanned::span)),
            ("still", self.still.as_ref().map(Spanned::span)),
            ("readout_us", self.readout_us.as_ref().map(Spanned::span)),
            ("faults", self.faults.as_ref().map(Spanned::span)),
            ("memory", self.memory.as_ref().map(Spanned::span)),
            ("gain_step_db", self.gain_step_db.as_ref().map(Spanned::span)),
            ("fixed_exposure_us", self.fixed_exposure_us.as_ref().map(Spanned::span)),
        ];
        keys.into_iter().filter_map(|(key, place)| place.map(|place| (key, place)))
    }
}

impl Reader<'_> {
    pub(super) fn source(&self, table: Spanned<SourceTable>) -> Result<Source, ConfigError> {
        let (span, table) = (table.span(), table.into_inner());
        let kind = table.kind.get_ref().as_str();
        let keys: &[&str] = match kind {
            "aravis" => &["serial"],
            "replay" => &["path"],
            "simulated" => &["serial", "still", "readout_us", "faults"],
            "v4l2" => &["path", "serial", "memory", "gain_step_db", "fixed_exposure_us"],
            other => {
                let allowed = "\"aravis\", \"replay\", \"simulated\" or \"v4l2\"";
                return Err(self.0.refuse(table.kind.span(), "kind", format!("\"{other}\""), allowed));
            }
        };
        // A key that belongs to another kind would be ignored in silence.
        for (key, place) in table.written() {
            if !keys.contains(&key) {
                let allowed = format!("no such key in a source of kind \"{kind}\"");
                return Err(self.0.refuse(place, key, "a value".into(), &allowed));
            }
        }
        match kind {
            "aravis" => Ok(Source::Aravis { serial: self.serial(table.serial, span)? }),
            "replay" => {
                let path = table.path.ok_or_else(|| self.missing("path", span))?;
                Ok(Source::Replay { path: self.resolve(path.get_ref()) })
            }
            "v4l2" => self.v4l2(table, span).map(Source::V4l2),
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
            (Some(path), None) => V4l2Device::Path(self.resolve(path.get_ref())),
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
        let fixed_exposure_us = table
            .fixed_exposure_us
            .map(|time| self.value("fixed_exposure_us", time, EXPOSURE, |us| (1.0..=1e7).contains(us)));
        Ok(V4l2 {
            device,
            memory,
            gain_step_db: gain_step_db.transpose()?,
            fixed_exposure_us: fixed_exposure_us.transpose()?,
        })
    }

    fn serial(&self, serial: Option<Spanned<String>>, span: Range<usize>) -> Result<String, ConfigError> {
        let serial = serial.ok_or_else(|| self.missing("serial", span))?;
        self.value("serial", serial, "the camera's serial", |text| !text.is_empty())
    }

    fn missing(&self, key: &str, span: Range<usize>) -> ConfigError {
        self.0.refuse(span, key, "nothing".into(), "this key must be written")
    }
}
