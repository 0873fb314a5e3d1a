//! `uvcam demo`: the whole chain without a camera.
//!
//! The driver and its consumers are processes of their own, started from this very program, as they are in flight. The driver
//! runs two simulated cameras that see the same: one flies unmasked, to show what it sees, the other masked.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use uvcam_masker::Mask;

use crate::args;
use crate::camera::simulated::airframe;
use crate::error::Error;
use crate::exit::Exit;

/// Image of the mvBlueFOX-MLC200wG, the camera of most UVDAR units, px.
const SIZE: (u32, u32) = (752, 480);
const FPS: u32 = 60;
/// By how much the mask is larger than the airframe, px: what moves with vibration stays inside.
const MARGIN_PX: i64 = 6;

pub(super) fn execute(arguments: &args::Demo) -> Result<Exit, Error> {
    let demo = Demo::prepare(&arguments.out)?;
    let frames = (arguments.seconds * f64::from(FPS)).ceil().max(1.0).to_string();
    let mask = demo.file("mask.png");
    let driver = demo.start_driver()?;
    tracing::info!(
        "driver: process {}; consumer: another process, {frames} frames at {FPS} fps",
        driver.0.id()
    );
    let options = ["--frames".as_ref(), frames.as_ref(), "--mask".as_ref(), mask.as_os_str()];
    let watched = demo.watch("masked", &options, Stdio::inherit())?;
    demo.take_picture("unmasked", "input.png")?;
    demo.take_picture("masked", "masked.png")?;
    drop(driver);
    if watched == Exit::Done {
        tracing::info!("look at input.png, mask.png and masked.png in {}", demo.folder.display());
    }
    Ok(watched)
}

struct Demo {
    folder: PathBuf,
    program: PathBuf,
}

impl Demo {
    fn prepare(folder: &Path) -> Result<Self, Error> {
        fs::create_dir_all(folder).map_err(failed("making folder", folder))?;
        let program = std::env::current_exe().map_err(failed("finding", Path::new("this program")))?;
        let demo = Demo { folder: folder.into(), program };
        airframe_mask().save(&demo.file("mask.png"), &[])?;
        let config = demo.file("demo.toml");
        fs::write(&config, configuration()).map_err(failed("writing", &config))?;
        Ok(demo)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn uvcam(&self, command: &str) -> Command {
        let mut process = Command::new(&self.program);
        process.arg(command).arg("--config").arg(self.file("demo.toml"));
        process
    }

    fn start_driver(&self) -> Result<Driver, Error> {
        let mut process = self.uvcam("run");
        // Its status line would fight with the consumer's for the terminal.
        let child = process.env("UVCAM_LOG", "warn").stdout(Stdio::null()).spawn();
        Ok(Driver(child.map_err(failed("starting", &self.program))?))
    }

    fn watch(&self, camera: &str, options: &[&OsStr], stdout: Stdio) -> Result<Exit, Error> {
        let mut process = self.uvcam("watch");
        let status = process.arg(camera).args(["--timeout", "10"]).args(options).stdout(stdout).status();
        let status = status.map_err(failed("starting", &self.program))?;
        Ok(if status.success() { Exit::Done } else { Exit::SharedMemory })
    }

    /// Saves one frame of the camera under this name.
    fn take_picture(&self, camera: &str, name: &str) -> Result<(), Error> {
        let frames = self.file("frames");
        self.watch(
            camera,
            &["--frames".as_ref(), "1".as_ref(), "--save".as_ref(), frames.as_os_str()],
            Stdio::null(),
        )?;
        for entry in fs::read_dir(&frames).map_err(failed("reading", &frames))?.flatten() {
            fs::rename(entry.path(), self.file(name)).map_err(failed("moving", &entry.path()))?;
        }
        fs::remove_dir(&frames).map_err(failed("removing", &frames))
    }
}

/// The driver's process; it ends with this value.
struct Driver(Child);

impl Drop for Driver {
    fn drop(&mut self) {
        // Where it has ended by itself there is nothing left to end.
        let _ = kill_process(Pid::from_child(&self.0), Signal::TERM);
        let _ = self.0.wait();
    }
}

fn configuration() -> String {
    // A prefix of its own, so that a driver in flight is not disturbed.
    let mut text = format!("[ipc]\nprefix = \"uvcam_demo_{}_\"\n", std::process::id());
    for (name, mask) in [("masked", "mask.png"), ("unmasked", "none")] {
        text += &format!(
            "\n[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"simulated\", serial = \"DEMO\" }}\n\
             width = {}\nheight = {}\nfps = {FPS}\nexposure_us = 2500\nmask = \"{mask}\"\n",
            SIZE.0, SIZE.1
        );
    }
    text
}

/// The simulated airframe, grown by [`MARGIN_PX`].
fn airframe_mask() -> Mask {
    let shown = airframe(SIZE.0, SIZE.1);
    let around = |x: u32, y: u32, dx: i64, dy: i64| {
        let (x, y) = (i64::from(x) + dx, i64::from(y) + dy);
        u32::try_from(x).is_ok_and(|x| u32::try_from(y).is_ok_and(|y| shown(x, y)))
    };
    let reach = -MARGIN_PX..=MARGIN_PX;
    Mask::from_fn(SIZE.0, SIZE.1, |x, y| reach.clone().any(|dx| reach.clone().any(|dy| around(x, y, dx, dy))))
}

fn failed(doing: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::System { doing, path, source }
}
