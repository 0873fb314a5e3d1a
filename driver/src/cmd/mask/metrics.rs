//! `uvcam mask metrics`: the shape of masks in numbers (equation 14 and table 2 of "Towards Scalable and Fast UAV Deployment").

use std::path::Path;

use serde::Serialize;
use uvcam_masker::Mask;
use uvcam_masker::metrics::Spread;
use uvcam_shm_ipc::control::Part;

use crate::args;
use crate::cmd::table::columns;
use crate::error::Error;
use crate::exit::Exit;
use crate::generate::parts;

#[derive(Serialize)]
struct Report<'a> {
    masks: Vec<Measured<'a>>,
    /// Over all parts of all masks.
    over_all_parts: Option<Summary>,
}

#[derive(Serialize)]
struct Measured<'a> {
    file: &'a Path,
    parts: Vec<Part>,
}

#[derive(Serialize)]
struct Summary {
    parts: usize,
    area_px: MeanAndDeviation,
    perimeter_px: MeanAndDeviation,
    compactness: MeanAndDeviation,
}

#[derive(Serialize)]
struct MeanAndDeviation {
    mean: f64,
    standard_deviation: f64,
}

pub(super) fn execute(arguments: &args::MaskMetrics) -> Result<Exit, Error> {
    let mut masks = Vec::with_capacity(arguments.files.len());
    for file in &arguments.files {
        let mask = Mask::load(file).map_err(Error::MaskFile)?;
        masks.push(Measured { file, parts: parts(&mask) });
    }
    let over_all_parts = Summary::of(&masks);
    let report = Report { masks, over_all_parts };
    let text = if arguments.json {
        // A value of plain numbers and texts always has a JSON form.
        serde_json::to_string_pretty(&report).unwrap_or_default()
    } else if arguments.csv {
        report.lines().map(|cells| cells.join(",")).collect::<Vec<_>>().join("\n")
    } else {
        let mut text = columns(&report.lines().collect::<Vec<_>>());
        if let Some(summary) = &report.over_all_parts {
            text += &summary.lines();
        }
        text
    };
    super::super::print(&text)?;
    Ok(Exit::Done)
}

impl Report<'_> {
    /// A head, and a line for each part.
    fn lines(&self) -> impl Iterator<Item = [String; 5]> {
        let head = ["file", "part", "area_px", "perimeter_px", "compactness"].map(String::from);
        let parts = self.masks.iter().flat_map(|mask| (1..).zip(&mask.parts).map(|part| (mask.file, part)));
        let line = |(file, (number, part)): (&Path, (u32, &Part))| {
            [
                file.display().to_string(),
                number.to_string(),
                part.area_px.to_string(),
                format!("{:.2}", part.perimeter_px),
                format!("{:.2}", part.compactness),
            ]
        };
        [head].into_iter().chain(parts.map(line))
    }
}

impl Summary {
    fn of(masks: &[Measured<'_>]) -> Option<Self> {
        let parts: Vec<&Part> = masks.iter().flat_map(|mask| &mask.parts).collect();
        let spread = |number: fn(&Part) -> f64| {
            let values: Vec<f64> = parts.iter().map(|part| number(part)).collect();
            Spread::of(&values)
                .map(|Spread { mean, standard_deviation }| MeanAndDeviation { mean, standard_deviation })
        };
        Some(Summary {
            parts: parts.len(),
            area_px: spread(|part| part.area_px as f64)?,
            perimeter_px: spread(|part| part.perimeter_px)?,
            compactness: spread(|part| part.compactness)?,
        })
    }

    fn lines(&self) -> String {
        let line = |name: &str, of: &MeanAndDeviation| {
            format!("\n{name}  {:.2} +- {:.2}", of.mean, of.standard_deviation)
        };
        format!("\nover {} parts, mean +- standard deviation", self.parts)
            + &line("area_px", &self.area_px)
            + &line("perimeter_px", &self.perimeter_px)
            + &line("compactness", &self.compactness)
    }
}
