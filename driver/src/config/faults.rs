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

impl Reader<'_> {
    pub(super) fn faults(&self, tables: Vec<FaultTable>) -> Result<Vec<Fault>, ConfigError> {
        let mut faults = Vec::with_capacity(tables.len());
        for FaultTable { kind, at_frame, count, seconds, megabytes } in tables {
            let count =
                || self.value_or("count", count.clone(), 1, "1 to 1000000", |n| (1..=1_000_000).contains(n));
            let seconds = || {
                self.value_or("seconds", seconds.clone(), 1.0, "0.001 to 3600 s", |s| {
                    (0.001..=3600.0).contains(s)
                })
            };
            let megabytes = || {
                let allowed = "1 to 1048576 MB";
                self.value_or("megabytes", megabytes.clone(), 4096, allowed, |mb| (1..=1 << 20).contains(mb))
            };
            let fault = match kind.get_ref().as_str() {
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
                    return Err(self.0.refuse(kind.span(), "kind", format!("\"{other}\""), allowed));
                }
            };
            faults.push(Fault { at_frame, kind: fault });
        }
        faults.sort_by_key(|fault| fault.at_frame);
        Ok(faults)
    }
}
