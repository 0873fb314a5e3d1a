//! `uvcam generate`: a mask from pictures, from a camera, or from a camera of the running driver.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use uvcam_masker::file::read_gray;
use uvcam_shm_ipc::control::{Answer, ControlClient};

use crate::args;
use crate::config::{CameraConfig, Config};
use crate::control::{Ask, Reply};
use crate::error::Error;
use crate::exit::Exit;
use crate::generate::{Light, Order};
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
        return show(&[("files", report)], arguments.json);
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
    for camera in cameras {
        let report = match ControlClient::open(&config.ipc.settings, &camera.name)? {
            Some(driver) => ask_driver(&driver, camera, arguments, &stop)?,
            None => alone(camera, &config, arguments, &stop)?,
        };
        reports.push((camera.name.as_str(), report));
    }
    show(&reports, arguments.json)
}

fn from_files(arguments: &args::Generate, out: &Path) -> Result<Report, Error> {
    let ignored =
        uvcam_masker::generate::IgnoredRegion { rectangles: arguments.ignore.clone(), polygons: Vec::new() };
    let mut generator = Generator::new(arguments.wish.clone(), ignored);
    for file in &arguments.from {
        if generator.add(read_gray(file)?) {
            break;
        }
    }
    let recipe = generator.recipe();
    let mut generated = generator.finish()?;
    if let Some(mask) = &generated.mask {
        let software = concat!("uvcam ", env!("CARGO_PKG_VERSION"));
        mask.save(out, &[("Software", software.into()), ("Method", recipe)])?;
        generated.report.file = Some(out.into());
    }
    Ok(generated.report)
}

/// The running driver does the work.
fn ask_driver(
    driver: &ControlClient,
    camera: &CameraConfig,
    arguments: &args::Generate,
    stop: &AtomicBool,
) -> Result<Report, Error> {
    tracing::info!("{}: asking the running driver", camera.name);
    let ask = Ask::Generate { wish: arguments.wish.clone(), accept: arguments.accept };
    // A value of plain numbers and texts always has a JSON form.
    let answers = driver.ask(&serde_json::to_string(&ask).unwrap_or_default())?;
    let asked = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        match answers.next(GLANCE) {
            Answer::Text(text) => match serde_json::from_str(&text) {
                Ok(Reply::Generated { report }) => return Ok(*report),
                Ok(Reply::Failed { exit, cause }) => return Err(Error::Driver { exit, cause }),
                Ok(Reply::Done) | Err(_) => {
                    let cause = "it answers in another version; use the same version of uvcam".into();
                    return Err(Error::Driver { exit: Exit::Usage as u8, cause });
                }
            },
            Answer::Timeout if asked.elapsed() < PATIENCE => {}
            Answer::Timeout | Answer::Over => {
                let cause =
                    "it ended before it answered; the mask in force is unchanged unless it says otherwise"
                        .into();
                return Err(Error::Driver { exit: Exit::SharedMemory as u8, cause });
            }
        }
    }
    Err(Error::Usage("stopped; nothing was stored".into()))
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
    let ignored = camera.generate.ignored.clone();
    let order = Order {
        exposure_us: wish.exposure_us.unwrap_or(camera.generate.exposure_us),
        gain_db: wish.gain_db.unwrap_or(camera.generate.gain_db),
        generator: Generator::new(wish, ignored),
        cancelled: stop.clone(),
        done: Box::new(move |generator, light| drop(done.send((generator, light)))),
    };
    tracing::info!("{}: no driver runs, opening the camera", camera.name);
    Supervisor::fulfil_alone(camera, &config.ipc, Arc::default(), order);
    let (generator, light): (Generator, Result<Light, Error>) =
        result.recv().map_err(|_| Error::Usage("the camera gave no answer".into()))?;
    let provenance = light?.provenance(generator.recipe());
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Usage("stopped; nothing was stored".into()));
    }
    generator.finish()?.store(camera, &provenance, arguments.accept)
}

fn show(reports: &[(&str, Report)], json: bool) -> Result<Exit, Error> {
    for (name, report) in reports {
        for finding in &report.findings {
            tracing::warn!("{name}: {finding}");
        }
        if json {
            // A value of plain numbers and texts always has a JSON form.
            super::print(&serde_json::to_string_pretty(report).unwrap_or_default())?;
        } else {
            super::print(&table(name, report))?;
        }
    }
    let ok = reports.iter().all(|(_, report)| report.is_ok());
    Ok(if ok { Exit::Done } else { Exit::Refused })
}

fn table(name: &str, report: &Report) -> String {
    let mut lines =
        vec![format!("{name}: {}, {} frames, {:.2} s", report.verdict, report.frames_used, report.seconds)];
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
