//! `uvcam demo`: the whole chain without a camera.
//!
//! The driver and its consumers are processes of their own, started from this very program, as they are in flight. The driver
//! runs two simulated cameras that see the same: one flies unmasked, to show what it sees, the other masked.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use crate::args;
use crate::error::Error;
use crate::exit::Exit;

/// Image of the mvBlueFOX-MLC200wG, the camera of most UVDAR units, px.
const SIZE: (u32, u32) = (752, 480);
const FPS: u32 = 60;

pub(super) fn execute(arguments: &args::Demo) -> Result<Exit, Error> {
    let demo = Demo::prepare(&arguments.out)?;
    let driver = demo.start_driver()?;
    let id = driver.0.id();
    tracing::info!("1/3 driver, process {id}; it publishes nothing of a camera that has no mask yet");
    demo.take_picture("unmasked", "input.png")?;

    tracing::info!("2/3 the driver makes the mask from lit frames");
    let generated = demo.generate("masked")?;
    if generated != Exit::Done {
        return Ok(generated);
    }

    let frames = (arguments.seconds * f64::from(FPS)).ceil().max(1.0).to_string();
    tracing::info!("3/3 consumer, another process: {frames} frames at {FPS} fps");
    let mask = demo.file("mask.png");
    let options = ["--frames".as_ref(), frames.as_ref(), "--mask".as_ref(), mask.as_os_str()];
    let watched = demo.watch("masked", &options, Stdio::inherit())?;
    demo.take_picture("masked", "masked.png")?;
    drop(driver);
    if watched == Exit::Done {
        tracing::info!("look at input.png, mask.png and masked.png in {}", demo.folder.display());
    } else {
        tracing::error!(
            "to see what the driver says: uvcam run --config {}",
            demo.file("demo.toml").display()
        );
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
        let config = demo.file("demo.toml");
        // A mask of an earlier demonstration would be flown from the start.
        let _ = fs::remove_file(demo.file("mask.png"));
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
        // What it says would fight with the consumer's status line for the terminal.
        let child = process.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        Ok(Driver(child.map_err(failed("starting", &self.program))?))
    }

    fn watch(&self, camera: &str, options: &[&OsStr], stdout: Stdio) -> Result<Exit, Error> {
        let mut process = self.uvcam("watch");
        let status = process.arg(camera).args(["--timeout", "10"]).args(options).stdout(stdout).status();
        let status = status.map_err(failed("starting", &self.program))?;
        Ok(if status.success() { Exit::Done } else { Exit::SharedMemory })
    }

    fn generate(&self, camera: &str) -> Result<Exit, Error> {
        let status = self.uvcam("generate").args([camera, "--accept"]).status();
        let status = status.map_err(failed("starting", &self.program))?;
        Ok(if status.success() { Exit::Done } else { Exit::Refused })
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

impl Drop for Demo {
    fn drop(&mut self) {
        // Driver and consumers have left it empty but for its folders.
        let _ = fs::remove_dir_all(root_path());
    }
}

/// Folder of the demonstration's service files: short, as paths of sockets are.
fn root_path() -> PathBuf {
    PathBuf::from(format!("/tmp/uvcam_demo_{}", std::process::id()))
}

/// The driver's process; it ends with this value.
struct Driver(Child);

impl Drop for Driver {
    fn drop(&mut self) {
        // Where it has ended by itself there is nothing left to end.
        let _ = kill_process(Pid::from_child(&self.0), Signal::TERM);
        let _ = self.0.wait();
        // What it keeps for a driver that comes after: none does.
        for file in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if file.file_name().to_string_lossy().starts_with(&prefix()) {
                let _ = fs::remove_file(file.path());
            }
        }
    }
}

/// One of its own, so that a driver in flight is not disturbed.
fn prefix() -> String {
    format!("uvcam_demo_{}_", std::process::id())
}

fn configuration() -> String {
    let mut text = format!("[ipc]\nprefix = \"{}\"\nroot_path = {:?}\n", prefix(), root_path());
    for (name, mask) in [("masked", "mask.png"), ("unmasked", "none")] {
        text += &format!(
            "\n[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"simulated\", serial = \"DEMO\" }}\n\
             width = {}\nheight = {}\nfps = {FPS}\nexposure_us = 2500\nmask = \"{mask}\"\n\
             [camera.generate]\nignore = [\"::0:{}\"]\n",
            SIZE.0,
            SIZE.1,
            SIZE.1 / 2
        );
    }
    text
}

fn failed(doing: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::System { doing, path, source }
}
