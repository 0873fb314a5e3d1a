//! The script of a simulated camera's faults.

use serde::Deserialize;
use toml::Spanned;

use super::reader::Reader;
use super::{ConfigError, Fault, FaultKind};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FaultTable {
    kind: Spanned<String>,
    at_frame: u64,
    count: Option<Spanned<u64>>,
    seconds: Option<Spanned<f64>>,
    megabytes: Option<Spanned<u64>>,
}

/// The script, in the order of its frames.
pub(super) fn read(tables: Vec<FaultTable>, reader: &Reader<'_>) -> Result<Vec<Fault>, ConfigError> {
    let faults = tables.into_iter().map(|table| table.read(reader));
    let mut faults = faults.collect::<Result<Vec<_>, _>>()?;
    faults.sort_by_key(|fault| fault.at_frame);
    Ok(faults)
}

impl FaultTable {
    fn read(self, reader: &Reader<'_>) -> Result<Fault, ConfigError> {
        let FaultTable { kind, at_frame, count, seconds, megabytes } = self;
        let count = || reader.value_or("count", count, 1, "1 to 1000000", |n| (1..=1_000_000).contains(n));
        let seconds =
            || reader.value_or("seconds", seconds, 1.0, "0.001 to 3600 s", |s| (0.001..=3600.0).contains(s));
        let megabytes = || {
            let allowed = "1 to 1048576 MB";
            reader.value_or("megabytes", megabytes, 4096, allowed, |mb| (1..=1 << 20).contains(mb))
        };
        let kind = match kind.get_ref().as_str() {
            "lost" => FaultKind::Lost { count: count()? },
            "incomplete" => FaultKind::Incomplete { count: count()? },
            "freeze" => FaultKind::Freeze { seconds: seconds()? },
            "unplug" => FaultKind::Unplug { seconds: seconds()? },
            "wrong_settings" => FaultKind::WrongSettings { count: count()? },
            "hang" => FaultKind::Hang { seconds: seconds()? },
            "panic" => FaultKind::Panic,
            "leak" => FaultKind::Leak { megabytes: megabytes()? },
            other => {
                let allowed = "\"lost\", \"incomplete\", \"freeze\", \"unplug\", \"wrong_settings\", \"hang\", \"panic\" or \"leak\"";
                return Err(reader.0.refuse(kind.span(), "kind", format!("\"{other}\""), allowed));
            }
        };
        Ok(Fault { at_frame, kind })
    }
}
