//! Tables for people.

use serde::Serialize;
use uvcam_shm_ipc::health::Latency;

/// Lines of cells, each column as wide as its longest cell.
pub(super) fn columns<const N: usize>(lines: &[[String; N]]) -> String {
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; N] = std::array::from_fn(width);
    let text = |line: &[String; N]| {
        let cells = line.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(text).collect::<Vec<_>>().join("\n")
}

/// Names and values, one a line, the values below one another.
pub(super) fn rows(cells: &[(&str, String)]) -> String {
    let lines: Vec<_> = cells.iter().map(|(name, value)| [(*name).to_owned(), value.clone()]).collect();
    columns(&lines)
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
