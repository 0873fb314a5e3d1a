//! `uvcam mask`: work on mask files.

use serde::Serialize;
use uvcam_masker::check::{self, Report, Severity};
use uvcam_masker::{ImageViewMut, Mask, MaskId, file};

use super::table::rows;
use crate::args;
use crate::config::Config;
use crate::error::Error;
use crate::exit::Exit;
use crate::mask_store::MaskStore;

mod in_force;
mod metrics;

/// White islets smaller than this in both directions are filled, px: a marker detector fires on them.
const ISLET_PX: u32 = 8;

pub(super) fn execute(
    arguments: &args::Mask,
    config: impl FnOnce() -> Result<Config, Error>,
) -> Result<Exit, Error> {
    match arguments {
        args::Mask::Check(arguments) => check(arguments),
        args::Mask::Apply(arguments) => apply(arguments),
        args::Mask::Repair(arguments) => repair(arguments),
        args::Mask::Metrics(arguments) => metrics::execute(arguments),
        args::Mask::Accept(of) => in_force::change(&of.camera, &config()?, MaskStore::accept),
        args::Mask::Restore(of) => {
            in_force::change(&of.camera, &config()?, |store, size| store.restore(of.number, size))
        }
        args::Mask::Discard(of) => in_force::discard(&of.camera, &config()?),
        args::Mask::History(of) => in_force::history(&of.camera, &config()?),
    }
}

#[derive(Serialize)]
struct CheckReport {
    width: u32,
    height: u32,
    masked_px: u64,
    runs: usize,
    parts: Vec<Part>,
    grey_px: u64,
    mask_id: Option<String>,
    problems: Vec<Problem>,
}

#[derive(Serialize)]
struct Part {
    area_px: u64,
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

#[derive(Serialize)]
struct Problem {
    severity: &'static str,
    text: String,
}

fn check(arguments: &args::MaskCheck) -> Result<Exit, Error> {
    let picture = file::read_mask(&arguments.file, None).map_err(Error::MaskFile)?;
    let report = check::check(&picture, arguments.size);
    if arguments.json {
        // A value of plain numbers and texts always has a JSON form.
        super::print(&serde_json::to_string_pretty(&json(&report)).unwrap_or_default())?;
    } else {
        super::print(&table(&report))?;
    }
    for problem in &report.problems {
        match problem.severity() {
            Severity::Refused => tracing::error!("{}: {problem}", arguments.file.display()),
            Severity::Warning => tracing::warn!("{}: {problem}", arguments.file.display()),
        }
    }
    Ok(if report.can_fly() { Exit::Done } else { Exit::Refused })
}

fn json(report: &Report) -> CheckReport {
    CheckReport {
        width: report.width,
        height: report.height,
        masked_px: report.masked_px,
        runs: report.runs,
        parts: report
            .parts
            .iter()
            .map(|part| Part {
                area_px: part.area_px,
                x: part.x,
                y: part.y,
                width: part.width,
                height: part.height,
            })
            .collect(),
        grey_px: report.grey_px,
        mask_id: (report.mask_id != MaskId::NONE).then(|| report.mask_id.to_string()),
        problems: report
            .problems
            .iter()
            .map(|problem| Problem { severity: severity(problem.severity()), text: problem.to_string() })
            .collect(),
    }
}

fn severity(severity: Severity) -> &'static str {
    match severity {
        Severity::Warning => "warning",
        Severity::Refused => "refused",
    }
}

fn table(report: &Report) -> String {
    let total = (f64::from(report.width) * f64::from(report.height)).max(1.0);
    let areas: Vec<String> = report.parts.iter().map(|part| part.area_px.to_string()).collect();
    let id = if report.mask_id == MaskId::NONE { "none".into() } else { report.mask_id.to_string() };
    let parts = if areas.is_empty() { String::new() } else { format!(", of {} px", areas.join(", ")) };
    let share = report.masked_px as f64 / total * 100.0;
    rows(&[
        ("size", format!("{}x{}", report.width, report.height)),
        ("masked", format!("{} px ({share:.1} %) in {} runs", report.masked_px, report.runs)),
        ("parts", format!("{}{parts}", areas.len())),
        ("mask", id),
        ("verdict", if report.can_fly() { "can fly" } else { "must not fly" }.into()),
    ])
}

fn apply(arguments: &args::MaskApply) -> Result<Exit, Error> {
    let mask = Mask::load(&arguments.mask).map_err(Error::MaskFile)?;
    let mut picture = file::read_gray(&arguments.input)?;
    let (width, height) = picture.dimensions();
    let mut image = ImageViewMut::new(&mut picture, width, height, width as usize, 1)?;
    mask.apply(&mut image)?;
    file::write_gray(&arguments.output, &picture, &[])?;
    Ok(Exit::Done)
}

fn repair(arguments: &args::MaskRepair) -> Result<Exit, Error> {
    let picture = file::read_mask(&arguments.input, None).map_err(Error::MaskFile)?;
    let mask = match arguments.threshold {
        Some(threshold) => Mask::try_binarised(&picture, threshold),
        None => Mask::from_gray(&picture),
    };
    let mask = mask.map_err(|error| Error::Mask(format!("{}: {error}", arguments.input.display())))?;
    let repaired = check::fill_islets(&mask, ISLET_PX);
    repaired.save(&arguments.output, &[])?;
    tracing::info!(
        "{}: {} px masked, {} px of white islets filled, mask {}",
        arguments.output.display(),
        repaired.masked_px(),
        repaired.masked_px() - mask.masked_px(),
        repaired.id()
    );
    Ok(Exit::Done)
}
