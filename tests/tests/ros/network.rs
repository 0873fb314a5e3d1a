//! A ROS of a test's own, on loopback, and subscribers that write down what they get.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use rustix::process::Signal;
use serde_json::Value;
use uvcam_tests::{Process, Stage, c, stderr, wait_until};

/// The camera's name as UVDAR has it.
pub const CAMERA: &str = "/uav1/uvdar_bluefox/left";
/// Debian's Python, which has Debian's modules of ROS.
pub const PYTHON: &str = "/usr/bin/python3";
pub const NODELET: &str = "/usr/lib/nodelet/nodelet";

pub fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shm_ipc/ros")
}

pub fn tests() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ros")
}

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("ros")
}

/// CMake's first step, with libuvcam of this build.
pub fn configure(source: &Path, name: &str, flags: &[&str]) -> PathBuf {
    let build = folder().join(name);
    let mut cmake = Command::new("cmake");
    cmake.arg("-S").arg(source).arg("-B").arg(&build).args(flags);
    cmake.arg(format!("-DCMAKE_PREFIX_PATH={}", c::prefix().display()));
    cmake.arg(format!("-DCMAKE_INSTALL_PREFIX={}", folder().join("prefix").display()));
    // CMake asks for Python in two ways, and takes the first one of the path.
    cmake.arg(format!("-DPython3_EXECUTABLE={PYTHON}")).arg(format!("-DPYTHON_EXECUTABLE={PYTHON}"));
    c::succeeds(&mut cmake);
    build
}

/// Where the package and the tests' own nodelet are installed, built as in a catkin workspace.
pub fn prefix() -> &'static Path {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        for (source, name) in [(package(), "uvcam_ros"), (tests(), "probe")] {
            let build = configure(&source, name, &["-DCATKIN_BUILD_BINARY_PACKAGE=ON"]);
            c::succeeds(Command::new("cmake").arg("--build").arg(&build).arg("--parallel"));
            c::succeeds(Command::new("cmake").arg("--install").arg(&build));
        }
        folder().join("prefix")
    })
}

/// A ROS of this test's own, on loopback: what it starts is killed where the test ends first.
pub struct Ros<'a> {
    stage: &'a Stage,
    pub port: u16,
}

impl<'a> Ros<'a> {
    pub fn new(stage: &'a Stage) -> Self {
        let free = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        Ros { stage, port: free.local_addr().unwrap().port() }
    }

    /// A program of this ROS.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        let prefix = prefix();
        command.env("ROS_MASTER_URI", format!("http://127.0.0.1:{}", self.port)).env("ROS_IP", "127.0.0.1");
        command.env("ROS_LOG_DIR", self.stage.file("log")).env("ROS_HOME", self.stage.file("home"));
        command.env("ROS_PACKAGE_PATH", format!("{}:/usr/share", prefix.join("share").display()));
        command.env("CMAKE_PREFIX_PATH", prefix).env("LD_LIBRARY_PATH", c::prefix().join("lib"));
        command.env_remove("ROS_HOSTNAME").env_remove("PYTHONPATH");
        command
    }

    /// What `roscore` starts to be found by.
    pub fn master(&self) -> Process {
        let mut command = self.command(PYTHON);
        let master =
            Process::start(command.args(["/usr/bin/rosmaster", "--core", "-p", &self.port.to_string()]));
        wait_until("a master that listens", || TcpStream::connect(("127.0.0.1", self.port)).is_ok());
        master
    }

    pub fn manager(&self) -> Process {
        Process::start(self.command(NODELET).args(["manager", "__name:=manager"]))
    }

    /// Loads a nodelet; [`unload`] unloads it.
    pub fn load(&self, class: &str, words: &[&str]) -> Process {
        Process::start(self.command(NODELET).args(["load", class, "/manager"]).args(words))
    }

    /// The words that tell a node or nodelet which camera it is.
    pub fn camera_words(&self) -> [String; 4] {
        let settings = self.stage.settings();
        let (namespace, name) = CAMERA.rsplit_once('/').unwrap();
        [
            format!("__ns:={namespace}"),
            format!("__name:={name}"),
            format!("_prefix:={}", settings.prefix),
            format!("_root_path:={}", settings.root_path.display()),
        ]
    }

    /// Loads the camera's nodelet.
    pub fn camera(&self, words: &[&str]) -> Process {
        let camera = self.camera_words();
        let all: Vec<&str> = camera.iter().map(String::as_str).chain(words.iter().copied()).collect();
        self.load("uvcam_ros/CameraNodelet", &all)
    }

    /// Loads a subscriber of the camera into the same manager.
    pub fn probe(&self) -> (Process, Probe) {
        let file = self.stage.file("probe");
        let image = format!("~image:={CAMERA}/image_raw");
        let words = ["__name:=probe", &image, &format!("_file:={}", file.display())];
        (self.load("uvcam_ros_probe/Probe", &words), Probe(file))
    }

    /// Starts a subscriber of the camera in Python.
    pub fn listener(&self, name: &str) -> (Process, Listener) {
        self.listener_of(name, CAMERA)
    }

    pub fn listener_of(&self, name: &str, camera: &str) -> (Process, Listener) {
        let file = self.stage.file(name);
        let mut command = self.command(PYTHON);
        command.arg(tests().join("listener.py")).arg(&file).arg(camera);
        (Process::start(&mut command), Listener(file))
    }
}

/// Unloads a nodelet, as roslaunch does.
pub fn unload(loader: Process) {
    loader.signal(Signal::INT);
    let output = loader.finish();
    assert!(output.status.success(), "{}: {}", output.status, stderr(&output));
}

/// What roslaunch started ends with it, where it is asked to.
pub struct Launched(pub Option<Process>);

impl Drop for Launched {
    fn drop(&mut self) {
        self.0.take().map(Process::stop);
    }
}

/// What is complete of a file that another process writes.
pub fn lines(file: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let complete = text.rfind('\n').map_or("", |end| &text[..end]);
    complete.lines().map(str::to_owned).collect()
}

/// The subscriber in the manager.
pub struct Probe(PathBuf);

/// What it saw of an image.
pub struct Seen {
    pub stamp: u64,
    pub address: String,
    pub is_black: bool,
}

impl Probe {
    pub fn seen(&self) -> Vec<Seen> {
        let parsed = lines(&self.0).into_iter().map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            Seen { stamp: words[0].parse().unwrap(), address: words[1].to_owned(), is_black: words[2] == "1" }
        });
        parsed.collect()
    }

    pub fn stamps(&self) -> Vec<u64> {
        self.seen().iter().map(|seen| seen.stamp).collect()
    }

    /// Waits until as many more images have come, and returns how many that are in all.
    pub fn more(&self, count: usize) -> usize {
        let before = lines(&self.0).len();
        wait_until("images in the manager", || lines(&self.0).len() >= before + count);
        before + count
    }
}

/// The subscriber in Python.
pub struct Listener(PathBuf);

impl Listener {
    pub fn heard(&self, kind: &str) -> Vec<Value> {
        let parsed = lines(&self.0).into_iter().map(|line| serde_json::from_str::<Value>(&line).unwrap());
        parsed.filter(|message| message["kind"] == kind).collect()
    }

    pub fn stamps(&self, kind: &str) -> Vec<u64> {
        self.heard(kind).iter().map(|message| message["stamp"].as_u64().unwrap()).collect()
    }

    /// Waits for a report of one subject that fulfils `condition`.
    pub fn report(&self, subject: &str, condition: impl Fn(&Value) -> bool) -> Value {
        let mut found = None;
        let is_subject = |report: &Value| report["name"].as_str().unwrap().ends_with(&format!(": {subject}"));
        wait_until("a report", || {
            found =
                self.heard("diagnostics").into_iter().find(|report| is_subject(report) && condition(report));
            found.is_some()
        });
        found.unwrap()
    }
}
