//! Figures for people: rows of names and values, and latencies in columns.

use serde::Serialize;
use uvcam_shm_ipc::health::Latency;

/// Names and values, one a line, the values below one another.
pub(super) fn rows(cells: &[(&str, String)]) -> String {
    let width = cells.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let lines: Vec<String> = cells.iter().map(|(name, value)| format!("{name:<width$}  {value}")).collect();
    lines.join("\n")
}

/// The identity of a mask, and whether frames are left as they are.
pub(super) fn describe_mask(id: Option<&str>, is_attached: bool) -> String {
    match (id, is_attached) {
        (None, _) => "none".into(),
        (Some(id), false) => id.into(),
        (Some(id), true) => format!("{id}, attached: frames are NOT BLANKED"),
    }
}

/// Latencies in microseconds.
#[derive(Debug, Serialize)]
pub(super) struct LatencyUs {
    p50: f64,
    p90: f64,
    p99: f64,
    p999: f64,
    max: f64,
}

impl LatencyUs {
    /// What stands above [`LatencyUs::cells`].
    pub(super) const COLUMNS: &str = "     p50      p90      p99    p99.9      max  us";

    /// The five values in columns.
    pub(super) fn cells(&self) -> String {
        let LatencyUs { p50, p90, p99, p999, max } = self;
        format!("{p50:8.1} {p90:8.1} {p99:8.1} {p999:8.1} {max:8.1}")
    }

    /// The median and the value that one frame in a hundred exceeds.
    pub(super) fn p50_and_p99(&self) -> (f64, f64) {
        (self.p50, self.p99)
    }
}

impl From<Latency> for LatencyUs {
    fn from(latency: Latency) -> Self {
        let us = |ns: u64| (ns as f64 / 100.0).round() / 10.0;
        let Latency { p50_ns, p90_ns, p99_ns, p999_ns, max_ns, .. } = latency;
        LatencyUs { p50: us(p50_ns), p90: us(p90_ns), p99: us(p99_ns), p999: us(p999_ns), max: us(max_ns) }
    }
}
