//! `[camera.realtime]` as written, and its way to a valid [`Realtime`].

use serde::Deserialize;
use toml::Spanned;

use super::ConfigError;
use super::document::Reader;
use crate::realtime::{LARGEST_CPU, Realtime};

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct RealtimeTable {
    priority: Option<Spanned<u8>>,
    cpus: Option<Vec<Spanned<usize>>>,
}

impl RealtimeTable {
    pub(super) fn read(self, reader: &Reader<'_>) -> Result<Realtime, ConfigError> {
        let allowed = format!("cores from 0 to {LARGEST_CPU}");
        let cpus = self.cpus.unwrap_or_default().into_iter();
        Ok(Realtime {
            priority: reader.value_or("priority", self.priority, 0, "0 to 99", |n| *n <= 99)?,
            cpus: cpus
                .map(|cpu| reader.value("cpus", cpu, &allowed, |cpu| *cpu <= LARGEST_CPU))
                .collect::<Result<_, _>>()?,
        })
    }
}
