//! `uvcam generate`: a mask from pictures, from a camera, or from a camera of the running driver.

mod report;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use uvcam_masker::file::{FileError, FrameError, read_frame};
use uvcam_shm_ipc::control::{ControlClient, NextReply};

use crate::args;
use crate::config::{self, CameraConfig, Config};
use crate::control::{Reply, Request};
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::generate::{Light, Order, light};
use crate::generator::{Generator, Report, store_of};
use crate::supervise::Supervisor;

/// A driver that says nothing for this long has died.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time between looks at whether to end.
const GLANCE: Duration = Duration::from_millis(200);

pub(super) fn execute(
    arguments: &args::Generate,
    config: impl FnOnce() -> Result<Config, Error>,
) -> Result<Exit, Error> {
    if let Some(out) = &arguments.out {
        let report = from_files(arguments, out)?;
        let exit = if report.is_ok() { Exit::Done } else { Exit::Refused };
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
        let driver = arguments
            .wish
            .check(&camera.generate)
            .and_then(|()| Ok(ControlClient::open(&config.ipc.settings, &camera.name)?));
        let report = match driver {
            Ok(Some(driver)) => ask_driver(&driver, camera, arguments, &stop),
            Ok(None) => alone(camera, &config, arguments, &stop),
            Err(error) => Err(error),
        };
        match report {
            Ok(report) => reports.push((camera.name.as_str(), report)),
            // The other cameras still get their masks.
            Err(error) => {
                tracing::error!("{}: {}", camera.name, with_causes(&error));
                exit = if exit == Exit::Done { error.exit() } else { exit };
            }
        }
    }
    report::show(&reports, arguments)?;
    let refused = reports.iter().any(|(_, report)| !report.is_ok());
    Ok(if exit == Exit::Done && refused { Exit::Refused } else { exit })
}

fn from_files(arguments: &args::Generate, out: &Path) -> Result<Report, Error> {
    let configured = config::Generate::default();
    arguments.wish.check(&configured)?;
    let mut generator = Generator::new(arguments.wish.clone(), &configured);
    // Bits that the brightest of them uses, as long as all seem to be unscaled.
    let mut unscaled = Some(0);
    for file in &arguments.from {
        let frame = read_frame(file).map_err(Error::Frame)?;
        unscaled = unscaled.zip(frame.unscaled_bits()).map(|(before, bits)| bits.max(before));
        // Pictures are few and chosen: all are taken, settled or not.
        generator.add(frame.gray)?;
    }
    if let Some((used_bits, path)) = unscaled.filter(|bits| *bits > 0).zip(arguments.from.first()) {
        let source = FrameError::Unscaled { used_bits };
        return Err(Error::Frame(FileError::NotAFrame { path: path.clone(), source }));
    }
    let generated = generator.finish(arguments.wish.exposure_us)?;
    let mut report = generated.report();
    if let Some(mask) = &generated.outcome.mask {
        let mut texts = generated.provenance();
        texts.push(("Size", format!("{}x{}", mask.width(), mask.height())));
        mask.save(out, &texts)?;
        report.file = Some(out.into());
    }
    Ok(report)
}

/// The running driver does the work.
fn ask_driver(
    driver: &ControlClient,
    camera: &CameraConfig,
    arguments: &args::Generate,
    stop: &AtomicBool,
) -> Result<Report, Error> {
    tracing::info!("{}: asking the running driver", camera.name);
    let request = Request::Generate { wish: arguments.wish.clone(), accept: arguments.accept };
    // A value of plain numbers and texts always has a JSON form.
    let replies = driver.request(&serde_json::to_string(&request).unwrap_or_default())?;
    let mut heard = Instant::now();
    let bar = report::Bar::new(&camera.name);
    while !stop.load(Ordering::Relaxed) {
        match replies.receive(GLANCE) {
            NextReply::Text(text) => match serde_json::from_str(&text) {
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
    camera: &CameraConfig,
    config: &Config,
    arguments: &args::Generate,
    stop: &Arc<AtomicBool>,
) -> Result<Report, Error> {
    store_of(camera)?;
    let (done, result) = channel();
    let wish = arguments.wish.clone();
    let (exposure_us, gain_db) = light(&wish, &camera.generate)?;
    let order = Order {
        exposure_us,
        gain_db,
        generator: Generator::new(wish, &camera.generate),
        progress: Box::new({
            let bar = report::Bar::new(&camera.name);
            move |progress| bar.show(progress)
        }),
        cancelled: stop.clone(),
        done: Box::new(move |generator, light| drop(done.send((generator, light)))),
    };
    tracing::info!("{}: no driver runs, opening the camera", camera.name);
    Supervisor::fulfil_alone(camera, &config.ipc, Arc::default(), order);
    let (generator, light): (Generator, Result<Light, Error>) =
        result.recv().map_err(|_| Error::Busy("the camera gave no answer".into()))?;
    let light = light?;
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Stopped);
    }
    let generated = generator.finish(Some(light.applied.exposure_us))?;
    generated.store(camera, light.provenance(), arguments.accept)
}
