//! What `uvcam generate` shows: a bar while frames are collected, and what came of them.

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use uvcam_shm_ipc::control::{GenerateReport, Progress, Verdict};

use crate::args;
use crate::error::Error;

/// Progress on stderr; nothing where that is no terminal.
pub(super) struct Bar(ProgressBar);

impl Bar {
    pub(super) fn new(camera: &str) -> Self {
        let bar = ProgressBar::new(0).with_prefix(camera.to_owned());
        let style = "{prefix}: {bar:30} {pos}/{len} frames at most, {msg}";
        // The template is fixed; without it the bar looks plainer.
        Bar(bar
            .with_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar())))
    }

    pub(super) fn show(&self, progress: Progress) {
        self.0.set_length(progress.most_frames.into());
        self.0.set_message(format!("{} px lit; move the lamp over the airframe", progress.lit_px));
        self.0.set_position(progress.frames.into());
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A report with the name of its camera.
#[derive(Serialize)]
struct OfCamera<'a> {
    camera: &'a str,
    #[serde(flatten)]
    report: &'a GenerateReport,
}

/// Prints the reports: one JSON object, or a list of them for all cameras; or texts.
pub(super) fn show(reports: &[(&str, GenerateReport)], arguments: &args::Generate) -> Result<(), Error> {
    for (camera, report) in reports {
        for finding in &report.findings {
            if finding.refuses {
                tracing::error!("{camera}: refused: {}", finding.message);
            } else {
                tracing::warn!("{camera}: {}", finding.message);
            }
        }
    }
    if !arguments.json {
        for (camera, report) in reports {
            crate::cmd::print(&table(camera, report))?;
        }
        return Ok(());
    }
    let of_cameras: Vec<_> = reports.iter().map(|(camera, report)| OfCamera { camera, report }).collect();
    let text = match &of_cameras[..] {
        [one] if !arguments.all => serde_json::to_string_pretty(one),
        several => serde_json::to_string_pretty(several),
    };
    // Values of plain numbers and texts always have a JSON form.
    crate::cmd::print(&text.unwrap_or_default())
}

fn table(camera: &str, report: &GenerateReport) -> String {
    let verdict = match report.verdict {
        Verdict::Ok => "ok",
        Verdict::Refused => "refused",
    };
    let mut lines = vec![format!(
        "{camera}: {verdict}, {} frames, {} candidate pixels, {:.2} s",
        report.frames_used, report.candidates, report.seconds
    )];
    for (number, part) in (1..).zip(&report.parts) {
        lines.push(format!(
            "  part {number}: {} px, perimeter {:.0} px, compactness {:.1}",
            part.area_px, part.perimeter_px, part.compactness
        ));
    }
    if let Some(overlap) = report.overlap_with_mask_in_force {
        lines.push(format!("  overlap with the mask in force: {:.1} %", overlap * 100.0));
    }
    match &report.file {
        Some(file) if report.in_force => lines.push(format!("  in force: {}", file.display())),
        Some(file) => lines.push(format!("  stored: {}", file.display())),
        None => lines.push("  nothing was stored".into()),
    }
    lines.join("\n")
}
