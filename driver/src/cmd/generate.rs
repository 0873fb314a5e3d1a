//! `uvcam generate`: a mask from pictures, from a camera, or from a camera of the running driver.

mod report;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use uvcam_masker::file::{FileError, FrameError, read_frame};
use uvcam_shm_ipc::control::{
    self, ControlClient, GenerateReport, GenerateRequest, NextReply, Reply, Verdict,
};

use crate::args;
use crate::config::{self, CameraConfig, Config};
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::generate::{Generator, Request};
use crate::mask_store::MaskStore;
use crate::supervise::Supervisor;

/// A driver that says nothing for this long has died.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time between looks at whether to end.
const GLANCE: Duration = Duration::from_millis(200);

pub(super) fn execute(
    arguments: &args::Generate,
    config: impl FnOnce() -> Result<Config, Error>,
) -> Result<Exit, Error> {
    let request = request(arguments);
    if let Some(out) = &arguments.out {
        let report = from_files(&request, &arguments.from, out)?;
        let exit = if report.verdict == Verdict::Ok { Exit::Done } else { Exit::Refused };
        report::show(&[("files", report)], arguments)?;
        return Ok(exit);
    }
    let config = config()?;
    let chosen = |camera: &&CameraConfig| arguments.all || Some(&camera.name) == arguments.camera.as_ref();
    let cameras: Vec<&CameraConfig> = config.cameras.iter().filter(chosen).collect();
    if cameras.is_empty() {
        let names: Vec<&str> = config.cameras.iter().map(|camera| camera.name.as_str()).collect();
        let wanted = arguments.camera.as_deref().unwrap_or_default();
        return Err(Error::Usage(format!(
            "no camera \"{wanted}\" in the configuration; it has {}",
            names.join(", ")
        )));
    }
    let stop = super::stop_flag()?;
    let mut reports = Vec::new();
    let mut exit = Exit::Done;
    for camera in cameras {
        match generate(&request, camera, &config, &stop) {
            Ok(report) => reports.push((camera.name.as_str(), report)),
            // The other cameras still get their masks.
            Err(error) => {
                tracing::error!("{}: {}", camera.name, with_causes(&error));
                exit = if exit == Exit::Done { error.exit() } else { exit };
            }
        }
    }
    report::show(&reports, arguments)?;
    let refused = reports.iter().any(|(_, report)| report.verdict == Verdict::Refused);
    Ok(if exit == Exit::Done && refused { Exit::Refused } else { exit })
}

/// What the command line asks for.
fn request(arguments: &args::Generate) -> GenerateRequest {
    let method = match arguments.method {
        args::Method::Fused => control::Method::Fused,
        args::Method::Paper => control::Method::Paper,
    };
    GenerateRequest {
        method,
        frames: arguments.frames,
        ignore: arguments.ignore.clone(),
        replace: arguments.replace,
        accept: arguments.accept,
        exposure_us: arguments.exposure_us,
        gain_db: arguments.gain_db,
        sigma: arguments.sigma,
        eta: arguments.eta,
        leaf: arguments.leaf,
        k: arguments.k,
        tau: arguments.tau,
        kappa: arguments.kappa,
    }
}

fn from_files(request: &GenerateRequest, from: &[PathBuf], out: &Path) -> Result<GenerateReport, Error> {
    let mut generator = Generator::new(Request::try_from((request, &config::Generate::default()))?);
    // Bits that the brightest of them uses, as long as all seem to be unscaled.
    let mut unscaled = Some(0);
    for file in from {
        let frame = read_frame(file).map_err(Error::Frame)?;
        unscaled = unscaled.zip(frame.unscaled_bits()).map(|(before, bits)| bits.max(before));
        // Pictures are few and chosen: all are taken, settled or not.
        generator.add(frame.gray)?;
    }
    if let Some((used_bits, path)) = unscaled.filter(|bits| *bits > 0).zip(from.first()) {
        let source = FrameError::Unscaled { used_bits };
        return Err(Error::Frame(FileError::NotAFrame { path: path.clone(), source }));
    }
    let generated = generator.finish(request.exposure_us)?;
    let mut report = generated.report();
    if let Some(mask) = &generated.outcome.mask {
        let mut texts = generated.provenance();
        texts.push(("Size", format!("{}x{}", mask.width(), mask.height())));
        mask.save(out, &texts)?;
        report.file = Some(out.into());
    }
    Ok(report)
}

/// The running driver does the work; where none runs, it is done here.
fn generate(
    request: &GenerateRequest,
    camera: &CameraConfig,
    config: &Config,
    stop: &Arc<AtomicBool>,
) -> Result<GenerateReport, Error> {
    let checked = Request::try_from((request, &camera.generate))?;
    match ControlClient::open(&config.ipc.settings, &camera.name)? {
        Some(driver) => by_driver(&driver, request, camera, stop),
        None => alone(checked, camera, config, stop),
    }
}

fn by_driver(
    driver: &ControlClient,
    request: &GenerateRequest,
    camera: &CameraConfig,
    stop: &AtomicBool,
) -> Result<GenerateReport, Error> {
    tracing::info!("{}: asking the running driver", camera.name);
    let replies = driver.request(&control::Request::Generate(request.clone()).to_text())?;
    let mut heard = Instant::now();
    let bar = report::Bar::new(&camera.name);
    while !stop.load(Ordering::Relaxed) {
        match replies.receive(GLANCE) {
            NextReply::Text(text) => match text.parse() {
                Ok(Reply::Collecting { progress }) => {
                    heard = Instant::now();
                    bar.show(progress);
                }
                Ok(Reply::Generated { report }) => return Ok(*report),
                Ok(Reply::Failed { exit, cause }) => return Err(Error::Driver { exit, cause }),
                Ok(Reply::Done) | Err(_) => {
                    let cause = "it answers in another version; use the same version of uvcam".into();
                    return Err(Error::Driver { exit: Exit::Usage as u8, cause });
                }
            },
            NextReply::Timeout if heard.elapsed() < PATIENCE => {}
            NextReply::Timeout | NextReply::Over => {
                let cause =
                    "it ended before it answered; the mask in force is unchanged unless it says otherwise"
                        .into();
                return Err(Error::Driver { exit: Exit::SharedMemory as u8, cause });
            }
        }
    }
    Err(Error::Stopped)
}

/// No driver runs: the camera is opened here.
fn alone(
    request: Request,
    camera: &CameraConfig,
    config: &Config,
    stop: &Arc<AtomicBool>,
) -> Result<GenerateReport, Error> {
    // What cannot be stored need not be made.
    MaskStore::of(camera)?;
    tracing::info!("{}: no driver runs, opening the camera", camera.name);
    let bar = report::Bar::new(&camera.name);
    let progress = move |so_far| bar.show(so_far);
    let lit_frames = Supervisor::collect_alone(camera, &config.ipc, stop.clone(), request, progress)?;
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Stopped);
    }
    lit_frames.generate()?.store(camera)
}
