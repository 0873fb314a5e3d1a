//! A stage for end-to-end tests: the real binary, in processes of its own, in a folder and shared memory of the test's own.
//!
//! Everything here panics where it cannot do its work: a test that cannot run has failed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use uvcam::camera::kinds;
use uvcam::camera::source::Source;
use uvcam::camera::{Camera, CameraError};
use uvcam_masker::Mask;
use uvcam_shm_ipc::health::{Health, HealthReader};
use uvcam_shm_ipc::{Frame, Settings, Subscriber};

pub mod c;
pub mod conformance;
pub mod dice;
pub mod namespace;
pub mod network;
mod shared_memory;
pub mod users;

pub use shared_memory::SharedMemory;

/// Longest wait for something that must happen.
const PATIENCE: Duration = Duration::from_secs(20);

/// Opens a camera as the driver does.
///
/// # Errors
/// Those of the source.
pub fn open(source: &Source) -> Result<Box<dyn Camera>, CameraError> {
    kinds::source_of(source).open()
}

/// Opens the USB3 Vision or GigE Vision camera that a configuration calls `serial`.
///
/// # Errors
/// Those of the source.
pub fn open_aravis(serial: &str) -> Result<Box<dyn Camera>, CameraError> {
    open(&Source::Aravis { serial: serial.into() })
}

/// Opens a folder of pictures.
///
/// # Errors
/// Those of the source.
pub fn open_replay(folder: &Path) -> Result<Box<dyn Camera>, CameraError> {
    open(&Source::Replay { path: folder.into() })
}

/// A folder, a configuration and shared memory that no other test uses.
pub struct Stage {
    memory: SharedMemory,
}

impl Stage {
    /// A stage whose configuration is `cameras` behind an `[ipc]` table of its own.
    pub fn new(cameras: &str) -> Self {
        Stage::configured("", cameras)
    }

    /// The same, with a driver that runs all cameras in one process.
    pub fn in_one_process(cameras: &str) -> Self {
        Stage::configured("process_per_camera = false\n", cameras)
    }

    /// The same, with these keys at the configuration's top.
    pub fn configured(top: &str, cameras: &str) -> Self {
        let stage = Stage { memory: SharedMemory::new() };
        let Settings { prefix, root_path, .. } = stage.settings();
        let text = format!("{top}[ipc]\nprefix = \"{prefix}\"\nroot_path = {root_path:?}\n{cameras}");
        std::fs::write(stage.file("uvcam.toml"), text).unwrap();
        stage
    }

    /// A file in the stage's folder, which is also the configuration's.
    pub fn file(&self, name: &str) -> PathBuf {
        self.memory.folder().join(name)
    }

    /// The stage's folder.
    pub fn folder(&self) -> &Path {
        self.memory.folder()
    }

    /// What a consumer needs to know to find the stage's driver.
    pub fn settings(&self) -> Settings {
        self.memory.settings()
    }

    /// A command of `uvcam` with the stage's configuration.
    pub fn uvcam(&self, words: &[&str]) -> Command {
        let mut command = Command::new(binary());
        command.args(words).arg("--config").arg(self.file("uvcam.toml")).stdin(Stdio::null());
        command
    }

    /// Runs a command of `uvcam` to its end.
    pub fn output(&self, words: &[&str]) -> Output {
        self.uvcam(words).output().unwrap()
    }

    /// Starts `uvcam run`; it ends with the returned value.
    pub fn driver(&self) -> Process {
        Process::start(&mut self.uvcam(&["run"]))
    }

    /// Starts `uvcam watch` with these words behind it, its report as JSON.
    pub fn watch(&self, words: &[&str]) -> Process {
        Process::start(&mut self.uvcam(&[&["watch", "--json", "--timeout", "20"], words].concat()))
    }

    /// A consumer in this process.
    pub fn subscriber(&self, camera: &str) -> Subscriber {
        Subscriber::open(&self.settings(), camera).unwrap()
    }

    /// A reader of a camera's health in this process. The driver must run, or be about to.
    pub fn health(&self, camera: &str) -> HealthReader {
        let mut reader = None;
        wait_until("a driver that tells of the camera", || {
            reader = HealthReader::open(&self.settings(), camera).unwrap();
            reader.is_some()
        });
        reader.unwrap()
    }

    /// The process that runs a camera, once it has told of it.
    pub fn process_of(&self, camera: &str) -> Pid {
        let health = health_where("a record", &mut self.health(camera), |_| true);
        Pid::from_raw(health.process_id.try_into().unwrap()).unwrap()
    }

    /// Writes a mask that blanks a band of `rows` rows at the lower edge, and returns it.
    pub fn write_mask(&self, name: &str, (width, height): (u32, u32), rows: u32) -> Mask {
        let mask = Mask::from_fn(width, height, |_, y| y + rows >= height);
        mask.save(&self.file(name), &[]).unwrap();
        mask
    }
}

/// A configuration's table of a simulated camera of 752 x 480 px at 60 fps; `source` are further keys of its source.
pub fn simulated(name: &str, mask: &str, source: &str) -> String {
    format!(
        "[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"simulated\", serial = \"{name}\"{source} }}\n\
         width = 752\nheight = 480\nfps = 60\nexposure_us = 1000\nmask = \"{mask}\"\n"
    )
}

/// The next frame; it must come.
pub fn next_frame(subscriber: &mut Subscriber) -> Frame {
    let start = Instant::now();
    loop {
        if let Some(frame) = subscriber.receive().unwrap() {
            return frame;
        }
        subscriber.wait(Duration::from_millis(100)).unwrap();
        assert!(start.elapsed() < PATIENCE, "no frame within {PATIENCE:?}");
    }
}

/// Waits for a health record that fulfils `condition`, and returns it.
pub fn health_where(
    what: &str,
    reader: &mut HealthReader,
    mut condition: impl FnMut(&Health) -> bool,
) -> Health {
    let start = Instant::now();
    loop {
        if let Some(health) =
            reader.wait(Duration::from_millis(100)).unwrap().filter(|health| condition(health))
        {
            return health;
        }
        assert!(start.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
    }
}

/// Waits until `condition` holds; it must within `PATIENCE`.
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A running process. It is killed where the test ends first.
pub struct Process {
    child: Child,
}

impl Process {
    /// Starts the command with its output kept.
    pub fn start(command: &mut Command) -> Self {
        Process { child: command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap() }
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Kills it without a word, as a crash or an empty battery does. What it has started is gone as well afterwards.
    pub fn kill(mut self) {
        self.end();
    }

    fn end(&mut self) {
        let started = children(self.id());
        let _ = self.child.kill();
        let _ = self.child.wait();
        // They end by themselves, and may hold a device until then.
        let begin = Instant::now();
        while started.iter().any(|id| lives(*id)) && begin.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Asks it to stop, and returns what it said.
    pub fn stop(self) -> Output {
        self.signal(Signal::TERM);
        self.finish()
    }

    /// Waits for its end, and returns what it said.
    pub fn finish(mut self) -> Output {
        let read = |source: Option<Box<dyn Read + Send>>| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                source.unwrap().read_to_end(&mut text).unwrap();
                text
            })
        };
        let stdout = read(self.child.stdout.take().map(|pipe| Box::new(pipe) as _));
        let stderr = read(self.child.stderr.take().map(|pipe| Box::new(pipe) as _));
        let status = self.child.wait().unwrap();
        Output { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
    }

    /// Waits for its end, and returns its JSON; it must have succeeded.
    pub fn json(self) -> Value {
        let output = self.finish();
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Resident memory in KiB, of its children as well.
    pub fn resident_kib(&self) -> u64 {
        let processes = children(self.id()).into_iter().chain([self.id()]);
        let resident = |id| status_field(id, "VmRSS:")?.trim_end_matches(" kB").parse::<u64>().ok();
        processes.map(|id| resident(id).unwrap()).sum()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
        // Where a test fails, the reason may be what the process said.
        if std::thread::panicking()
            && let Some(mut said) = self.child.stderr.take()
        {
            let mut text = String::new();
            let _ = said.read_to_string(&mut text);
            eprintln!("process {} said: {text}", self.id());
        }
    }
}

/// The processes that this one has started and that have not been waited for.
pub fn children(parent: u32) -> Vec<u32> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let ids = processes.filter_map(|process| process.file_name().to_str()?.parse().ok());
    ids.filter(|id| status_field(*id, "PPid:").is_some_and(|id| id == parent.to_string())).collect()
}

/// Whether a process has files open, or may open some. Where nobody waits for it, a zombie remains, and is one while other threads of it
/// still end.
pub fn lives(id: u32) -> bool {
    let is_zombie = status_field(id, "State:").is_none_or(|state| state.starts_with('Z'));
    let threads = std::fs::read_dir(format!("/proc/{id}/task")).map_or(0, Iterator::count);
    !is_zombie || threads > 1
}

/// A field of a process's status (proc_pid_status(5)); nothing where there is no such process any more.
pub fn status_field(id: u32, key: &str) -> Option<String> {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix(key)).map(|field| field.trim().to_owned())
}

/// What a process wrote to stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The `uvcam` binary of this build. Where there is no cargo, the environment variable `UVCAM_BINARY` names it.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| match std::env::var_os("UVCAM_BINARY") {
        Some(binary) => binary.into(),
        None => built(&["--package", "uvcam", "--bin", "uvcam"]).join("uvcam"),
    })
}

/// Builds something of another package, and returns the folder where it is: cargo builds those only when asked.
pub fn built(what: &[&str]) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    // Tests lie one folder below the programs.
    let folder = test.ancestors().skip(1).find(|folder| !folder.ends_with("deps")).unwrap();
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--quiet"]).args(what);
    build.arg("--target-dir").arg(folder.parent().unwrap()).current_dir(env!("CARGO_MANIFEST_DIR"));
    if folder.file_name().is_some_and(|name| name == "release") {
        build.arg("--release");
    }
    assert!(build.status().unwrap().success(), "{what:?} was not built");
    folder.to_owned()
}
