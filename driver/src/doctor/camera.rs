//! What the configuration asks of each camera.

use std::io::ErrorKind;
use std::path::Path;

use uvcam_masker::check::{self, Problem};
use uvcam_masker::file::{self, FileError};

use super::usb::UsbCamera;
use super::{Finding, Severity};
use crate::camera::CameraError;
use crate::causes::with_causes;
use crate::config::{CameraConfig, Config, MaskChoice, MaskMode, Simulated, Source};

/// Whether the masks can fly, and the exposures fit.
pub(super) fn examine(config: &Config, connected: &[UsbCamera]) -> Vec<Finding> {
    [masks(config), exposures(config, connected)].concat()
}

/// Whether every mask is there, has the image's size, and can fly.
fn masks(config: &Config) -> Vec<Finding> {
    let findings = config.cameras.iter().flat_map(|camera| match &camera.mask {
        MaskChoice::None => Vec::new(),
        MaskChoice::File(path) => mask(camera, path).into_iter().chain(not_blanked(camera)).collect(),
    });
    findings.collect()
}

/// Whether frames are left as they are.
fn not_blanked(camera: &CameraConfig) -> Option<Finding> {
    (camera.mask_mode == MaskMode::Attach).then(|| {
        let finding = format!(
            "{}: mask_mode = \"attach\", so the airframe is in sight of who does not ask for the mask",
            camera.name
        );
        let remedy =
            "let every consumer apply the mask that comes beside the frames, or write mask_mode = \"blank\"";
        Finding::new(Severity::Warning, "mask", finding, remedy.to_owned())
    })
}

fn mask(camera: &CameraConfig, path: &Path) -> Vec<Finding> {
    let name = &camera.name;
    let generate = format!("uvcam generate {name}, a look at the candidate, and uvcam mask accept {name}");
    let size = (camera.settings.width, camera.settings.height);
    let gray = match file::read_mask(path, Some(size)) {
        Ok(gray) => gray,
        Err(error) => {
            let missing =
                matches!(&error, FileError::Read { source, .. } if source.kind() == ErrorKind::NotFound);
            let finding = match missing {
                true => format!("{name}: there is no mask {}, so nothing is published", path.display()),
                false => format!("{name}: {}", with_causes(&error)),
            };
            return vec![Finding::new(Severity::Fault, "mask", finding, generate)];
        }
    };
    let problems = check::check(&gray, Some(size)).problems;
    let found = problems.iter().map(|problem| {
        let severity = match problem.severity() {
            check::Severity::Refused => Severity::Fault,
            check::Severity::Warning => Severity::Warning,
        };
        let file = path.display();
        let remedy = match problem {
            Problem::NotBinary { .. } => format!("uvcam mask repair --threshold 128 {file} {file}"),
            Problem::Islets { .. } => format!("uvcam mask repair {file} {file}"),
            _ => generate.clone(),
        };
        Finding::new(severity, "mask", format!("{name}: {file}: {problem}"), remedy)
    });
    found.collect()
}

/// Whether exposure and readout fit the frame period. A camera whose readout is not known is taken to need none, so that only
/// certain faults are found.
fn exposures(config: &Config, connected: &[UsbCamera]) -> Vec<Finding> {
    let findings = config.cameras.iter().filter_map(|camera| {
        let readout_us = match &camera.source {
            Source::Simulated(Simulated { readout_us, .. }) => *readout_us,
            source => {
                let device = connected.iter().find(|device| device.is(source.serial()));
                device.filter(|device| device.is_mvbluefox()).map_or(0.0, |_| mvbluefox_readout_us(camera))
            }
        };
        match camera.settings.check_exposure_fits(readout_us) {
            Err(CameraError::Refused { asked, applied, remedy, .. }) => Some(Finding::new(
                Severity::Fault,
                "exposure",
                format!("{}: exposure_us = {asked} makes {applied}", camera.name),
                remedy,
            )),
            _ => None,
        }
    });
    findings.collect()
}

/// Readout of an mvBlueFOX, microseconds: (width + 61) (height + 45) pixels at its clock of 40 MHz, and 0.2 ms until the next
/// exposure.
fn mvbluefox_readout_us(camera: &CameraConfig) -> f64 {
    let (width, height) = (f64::from(camera.settings.width), f64::from(camera.settings.height));
    (width + 61.0) * (height + 45.0) / 40.0 + 200.0
}
