//! `uvcam stats`: how the cameras of a running driver are.

use std::time::{Duration, Instant};

use serde::Serialize;
use uvcam_masker::MaskId;
use uvcam_shm_ipc::health::{Health, HealthReader, MaskMode};
use uvcam_shm_ipc::monotonic_ns;

use super::table::{LatencyUs, describe_mask, rows};
use crate::args;
use crate::config::Config;
use crate::error::Error;
use crate::exit::Exit;

/// How long a driver may take to answer: it writes a record every second.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time between looks for a driver that just starts.
const RETRY: Duration = Duration::from_millis(50);

#[derive(Serialize)]
struct Report {
    camera: String,
    state: &'static str,
    state_for_s: f64,
    cause: &'static str,
    last_error: String,
    frame_rate: f64,
    published: u64,
    lost: u64,
    incomplete: u64,
    no_free_slot: u64,
    epochs: u64,
    failures: u64,
    temperature_c: Option<f64>,
    mask_id: Option<String>,
    mask_mode: &'static str,
    config_digest: String,
    arrival_to_masked_us: LatencyUs,
    masked_to_sent_us: LatencyUs,
    process_id: u32,
    running_for_s: f64,
    resident_bytes: u64,
    cpu_s: f64,
}

pub(super) fn execute(arguments: &args::Stats, config: &Config) -> Result<Exit, Error> {
    let cameras: Vec<&str> = match &arguments.camera {
        Some(camera) => vec![camera],
        None => config.cameras.iter().map(|camera| camera.name.as_str()).collect(),
    };
    let reports = cameras.into_iter().map(|camera| ask(config, camera)).collect::<Result<Vec<_>, Error>>()?;
    let text = match arguments.json {
        // A list of plain numbers and texts always has a JSON form.
        true => serde_json::to_string_pretty(&reports).unwrap_or_default(),
        false => reports.iter().map(Report::table).collect::<Vec<_>>().join("\n\n"),
    };
    super::print(&text)?;
    Ok(Exit::Done)
}

fn ask(config: &Config, camera: &str) -> Result<Report, Error> {
    let begin = Instant::now();
    let absent = || Error::Driver {
        exit: Exit::SharedMemory as u8,
        cause: format!("none tells of camera \"{camera}\": start `uvcam run` with the same [ipc] settings"),
    };
    let mut reader = loop {
        match HealthReader::open(&config.ipc.settings, camera)? {
            Some(reader) => break reader,
            None if begin.elapsed() < PATIENCE => std::thread::sleep(RETRY),
            None => return Err(absent()),
        }
    };
    reader.wait(PATIENCE)?.map(|health| Report::new(camera, &health)).ok_or_else(absent)
}

impl Report {
    fn new(camera: &str, health: &Health) -> Self {
        let now_ns = monotonic_ns();
        let seconds_since = |then_ns| round(now_ns.saturating_sub(then_ns) as f64 * 1e-9);
        let mask = MaskId(health.mask_id);
        Report {
            camera: camera.into(),
            // The reader has let valid codes pass only.
            state: health.state().map_or("unknown", |state| state.as_str()),
            state_for_s: seconds_since(health.state_since_monotonic_ns),
            cause: health.cause().map_or("unknown", |cause| cause.as_str()),
            last_error: health.last_error(),
            frame_rate: round(health.frame_rate),
            published: health.published,
            lost: health.lost,
            incomplete: health.incomplete,
            no_free_slot: health.no_free_slot,
            epochs: health.epochs,
            failures: health.failures,
            temperature_c: health.temperature_c(),
            mask_id: (mask != MaskId::NONE).then(|| mask.to_string()),
            mask_mode: health.mask_mode().map_or("unknown", |mode| mode.as_str()),
            config_digest: health.config_digest.iter().map(|byte| format!("{byte:02x}")).collect(),
            arrival_to_masked_us: health.arrival_to_masked.into(),
            masked_to_sent_us: health.masked_to_sent.into(),
            process_id: health.process_id,
            running_for_s: seconds_since(health.started_monotonic_ns),
            resident_bytes: health.resident_bytes,
            cpu_s: round(health.cpu_ns as f64 * 1e-9),
        }
    }

    fn table(&self) -> String {
        let mut cells = vec![
            ("camera", self.camera.clone()),
            ("state", format!("{} for {:.0} s", self.state, self.state_for_s)),
        ];
        if !self.last_error.is_empty() {
            cells.push(("last error", format!("{} ({})", self.last_error, self.cause)));
        }
        cells.extend([
            ("published", format!("{} frames, {:.1} a second", self.published, self.frame_rate)),
            ("lost", self.lost.to_string()),
            ("arrived incomplete", self.incomplete.to_string()),
            ("no free slot", format!("{} times", self.no_free_slot)),
            ("epochs", format!("{}, {} failures", self.epochs, self.failures)),
            (
                "temperature",
                self.temperature_c
                    .map_or_else(|| "not told".into(), |celsius| format!("{celsius:.1} \u{b0}C")),
            ),
            ("mask", describe_mask(self.mask_id.as_deref(), self.mask_mode == MaskMode::Attach.as_str())),
            ("configuration", self.config_digest.clone()),
            ("latency", LatencyUs::COLUMNS.into()),
            ("arrival to masked", self.arrival_to_masked_us.cells()),
            ("masked to sent", self.masked_to_sent_us.cells()),
            (
                "driver",
                format!(
                    "process {}, {:.0} s, {:.1} MB of memory, {:.1} % of a processor",
                    self.process_id,
                    self.running_for_s,
                    self.resident_bytes as f64 * 1e-6,
                    100.0 * self.cpu_s / self.running_for_s.max(1e-3),
                ),
            ),
        ]);
        rows(&cells)
    }
}

fn round(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}
