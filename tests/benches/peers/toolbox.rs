//! The programs behind the chains: those of other projects are built here, where their packages are installed.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use uvcam_tests::c;

use crate::chain::{Chain, Program};
use crate::scene::Scene;

/// Longest wait for the ROS master.
const PATIENCE: Duration = Duration::from_secs(20);

/// What can be started.
pub struct Toolbox {
    gstreamer: Result<PathBuf, String>,
    ros1: Result<(PathBuf, RosMaster), String>,
    uvcam_ros1: Result<PathBuf, String>,
}

impl Toolbox {
    /// Builds what can be built.
    pub fn new() -> Toolbox {
        let ros1 = compile("ros1", &["roscpp"], &[]).and_then(|program| Ok((program, RosMaster::start()?)));
        let gstreamer = compile("gstreamer", &["gstreamer-app-1.0"], &[]).and_then(has_shm_elements);
        Toolbox { gstreamer, ros1, uvcam_ros1: compile_bridge() }
    }

    /// Why a chain cannot be measured on this machine.
    pub fn lacks(&self, chain: Chain) -> Option<&str> {
        match chain {
            Chain::Gstreamer => self.gstreamer.as_ref().err().map(String::as_str),
            Chain::Ros1 | Chain::Ros1Shared => self.ros1.as_ref().err().map(String::as_str),
            Chain::UvcamRos1 => {
                let lacks = self.uvcam_ros1.as_ref().err().or(self.ros1.as_ref().err());
                lacks.map(String::as_str)
            }
            _ => None,
        }
    }

    /// A process of a chain, to be started.
    pub fn command(&self, chain: Chain, program: &Program, scene: &Scene, seconds: f64) -> Command {
        let (mut command, way) = match program {
            Program::Driver => {
                let mut command = scene.stage.uvcam(&["run"]);
                command.env("UVCAM_LOG", "warn");
                return command;
            }
            Program::Peer(way) => (Command::new(env!("CARGO_BIN_EXE_peer")), way),
            Program::Cpp(way) => (self.cpp(chain), way),
        };
        command.arg(way).arg(scene.folder());
        command.args([scene.width, scene.height].map(|side| side.to_string()));
        command.args([scene.cameras.to_string(), seconds.to_string()]);
        command
    }

    fn cpp(&self, chain: Chain) -> Command {
        match (chain, &self.gstreamer, &self.ros1) {
            (Chain::Gstreamer, Ok(program), _) => Command::new(program),
            (Chain::Ros1 | Chain::Ros1Shared, _, Ok((program, master))) => {
                master.environment(Command::new(program))
            }
            (Chain::UvcamRos1, _, Ok((_, master))) => {
                let Ok(program) = &self.uvcam_ros1 else { panic!("it was not built") };
                let mut command = master.environment(Command::new(program));
                command.env("LD_LIBRARY_PATH", c::prefix().join("lib")).env("ROS_PACKAGE_PATH", "/usr/share");
                command
            }
            _ => panic!("{} has no program in C++", chain.name()),
        }
    }
}

/// Builds the consumer behind the bridge, with the bridge's own sources.
fn compile_bridge() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shm_ipc/ros/src");
    let sources = ["camera", "images", "master", "parameters", "report"];
    let mut words = vec![format!("-I{}", folder.display())];
    words.extend(sources.map(|name| folder.join(name).with_extension("cpp").display().to_string()));
    words.extend(c::pkg_config(&["--cflags", "--libs"]));
    // Debian's pkg-config files of these two want one of pluginlib, which is not there.
    words.extend(["-lcamera_info_manager", "-limage_transport"].map(str::to_owned));
    compile("uvcam_ros1", &["roscpp"], &words)
}

/// Builds a peer with the flags of pkg-config packages, and more.
fn compile(name: &str, packages: &[&str], words: &[String]) -> Result<PathBuf, String> {
    let flags = Command::new("pkg-config").args(["--cflags", "--libs"]).args(packages).output();
    let Some(flags) = flags.ok().filter(|output| output.status.success()) else {
        return Err(format!("pkg-config does not find {}", packages.join(", ")));
    };
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/programs").join(name);
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let mut compiler = Command::new("c++");
    compiler.args(["-std=c++17", "-O3", "-pthread", "-o"]).arg(&program).arg(source.with_extension("cpp"));
    compiler.args(words).args(String::from_utf8_lossy(&flags.stdout).split_whitespace());
    match compiler.output() {
        Ok(output) if output.status.success() => Ok(program),
        Ok(output) => Err(format!("c++ does not build it: {}", String::from_utf8_lossy(&output.stderr))),
        Err(error) => Err(format!("c++: {error}")),
    }
}

/// Passes a program on where GStreamer has the elements that it uses.
fn has_shm_elements(program: PathBuf) -> Result<PathBuf, String> {
    for element in ["shmsink", "appsrc"] {
        let found = Command::new("gst-inspect-1.0").args(["--exists", element]).status();
        if !found.is_ok_and(|status| status.success()) {
            return Err(format!("gst-inspect-1.0 does not find {element}"));
        }
    }
    Ok(program)
}

/// The name service of ROS 1, on a port of its own; ended when dropped.
struct RosMaster {
    master: Child,
    port: u16,
    folder: tempfile::TempDir,
}

impl RosMaster {
    fn start() -> Result<RosMaster, String> {
        let free = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("rosmaster");
        command.args(["--core", "-p", &port.to_string()]).env("ROS_LOG_DIR", folder.path());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let master = command.spawn().map_err(|error| format!("rosmaster: {error}"))?;
        let mut master = RosMaster { master, port, folder };
        let deadline = Instant::now() + PATIENCE;
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            if master.master.try_wait().unwrap().is_some() || Instant::now() > deadline {
                return Err("rosmaster does not listen".to_owned());
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(master)
    }

    /// The command, as a node of this master, on loopback.
    fn environment(&self, mut command: Command) -> Command {
        command.env("ROS_MASTER_URI", format!("http://127.0.0.1:{}", self.port));
        command.env("ROS_IP", "127.0.0.1").env("ROS_LOG_DIR", self.folder.path());
        command
    }
}

impl Drop for RosMaster {
    fn drop(&mut self) {
        let _ = self.master.kill();
        let _ = self.master.wait();
    }
}
