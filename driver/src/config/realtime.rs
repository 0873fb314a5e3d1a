//! `[camera.realtime]` as written, and its way to a valid [`Realtime`].

use serde::Deserialize;
use toml::Spanned;

use super::ConfigError;
use super::reader::Reader;
use crate::realtime::{LARGEST_CPU, Realtime};

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct RealtimeTable {
    priority: Option<Spanned<u64>>,
    cpus: Option<Vec<Spanned<u64>>>,
}

impl RealtimeTable {
    pub(super) fn read(self, reader: &Reader<'_>) -> Result<Realtime, ConfigError> {
        let allowed = format!("cores from 0 to {LARGEST_CPU}");
        let cpus = self.cpus.unwrap_or_default().into_iter();
        Ok(Realtime {
            priority: match self.priority {
                Some(priority) => reader.whole("priority", priority, "0 to 99", 0..=99)?,
                None => 0,
            },
            cpus: cpus
                .map(|cpu| reader.whole("cpus", cpu, &allowed, 0..=LARGEST_CPU as u64))
                .collect::<Result<_, _>>()?,
        })
    }
}
