//! What a consumer saw, in numbers.

use serde::Serialize;
use uvcam_masker::MaskId;
use uvcam_shm_ipc::health::MaskMode;
use uvcam_shm_ipc::{Flags, FrameHeader, Subscriber};

use crate::cmd::table::{LatencyUs, describe_mask, rows};
use crate::latency::LatencyHistogram;

/// Everything counted since the command began.
pub(super) struct Tally {
    pub(super) camera: String,
    pub(super) frames: u64,
    pub(super) masked_nonzero: u64,
    with_mask: bool,
    lost: u64,
    epochs: u64,
    first_arrival_ns: u64,
    last_arrival_ns: u64,
    size: (u32, u32),
    mask_id: MaskId,
    flags: Flags,
    latency: LatencyHistogram,
}

#[derive(Serialize)]
struct Report<'a> {
    camera: &'a str,
    frames: u64,
    lost: u64,
    epochs: u64,
    fps: f64,
    width: u32,
    height: u32,
    mask_id: Option<String>,
    mask_mode: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    masked_nonzero: Option<u64>,
    /// From the driver's send to this command's receipt, microseconds.
    latency_us: LatencyUs,
}

impl Tally {
    pub(super) fn new(camera: &str, with_mask: bool) -> Self {
        Tally {
            camera: camera.into(),
            frames: 0,
            masked_nonzero: 0,
            with_mask,
            lost: 0,
            epochs: 0,
            first_arrival_ns: 0,
            last_arrival_ns: 0,
            size: (0, 0),
            mask_id: MaskId::NONE,
            flags: Flags::NONE,
            latency: LatencyHistogram::default(),
        }
    }

    pub(super) fn add(&mut self, header: &FrameHeader, received_ns: u64, masked_nonzero: u64) {
        if self.frames == 0 {
            self.first_arrival_ns = header.arrival_monotonic_ns;
        }
        self.frames += 1;
        self.last_arrival_ns = header.arrival_monotonic_ns;
        self.masked_nonzero += masked_nonzero;
        self.size = (header.width, header.height);
        self.mask_id = MaskId(header.mask_id);
        self.flags = header.flags;
        self.latency.record(received_ns.saturating_sub(header.send_monotonic_ns));
    }

    pub(super) fn finish(&mut self, subscriber: &Subscriber) {
        self.lost = subscriber.lost();
        self.epochs = subscriber.epochs();
    }

    /// Frames a second between the first and the last one, by their arrival in the driver.
    fn fps(&self) -> f64 {
        let span_ns = self.last_arrival_ns.saturating_sub(self.first_arrival_ns);
        if span_ns == 0 { 0.0 } else { (self.frames - 1) as f64 * 1e9 / span_ns as f64 }
    }

    fn latency_us(&self) -> LatencyUs {
        self.latency.summary().into()
    }

    fn mask_id(&self) -> Option<String> {
        (self.mask_id != MaskId::NONE).then(|| self.mask_id.to_string())
    }

    /// Of the last frame.
    fn mask_mode(&self) -> MaskMode {
        match self.flags {
            flags if flags.contains(Flags::MASKED) => MaskMode::Blank,
            flags if flags.contains(Flags::MASK_ATTACHED) => MaskMode::Attach,
            _ => MaskMode::None,
        }
    }

    pub(super) fn json(&self) -> String {
        let report = Report {
            camera: &self.camera,
            frames: self.frames,
            lost: self.lost,
            epochs: self.epochs,
            fps: (self.fps() * 1000.0).round() / 1000.0,
            width: self.size.0,
            height: self.size.1,
            mask_id: self.mask_id(),
            mask_mode: self.mask_mode().as_str(),
            masked_nonzero: self.with_mask.then_some(self.masked_nonzero),
            latency_us: self.latency_us(),
        };
        // A value of plain numbers and texts always has a JSON form.
        serde_json::to_string_pretty(&report).unwrap_or_default()
    }

    pub(super) fn table(&self) -> String {
        let mut cells = vec![
            ("camera", format!("{}, {}x{}", self.camera, self.size.0, self.size.1)),
            ("frames", self.frames.to_string()),
            ("fps", format!("{:.2}", self.fps())),
            ("lost", self.lost.to_string()),
            ("epochs", self.epochs.to_string()),
            ("mask", describe_mask(self.mask_id().as_deref(), self.mask_mode() == MaskMode::Attach)),
        ];
        if self.with_mask {
            cells.push(("masked pixels that were not black", self.masked_nonzero.to_string()));
        }
        cells.push(("latency", LatencyUs::COLUMNS.into()));
        cells.push(("send to receive", self.latency_us().cells()));
        rows(&cells)
    }

    pub(super) fn line(&self, subscriber: &Subscriber) -> String {
        let (p50, p99) = self.latency_us().p50_and_p99();
        format!(
            "{}: {} frames, {:.1} fps, {} lost, latency p50 {p50:.0} us, p99 {p99:.0} us",
            self.camera,
            self.frames,
            self.fps(),
            subscriber.lost(),
        )
    }
}
