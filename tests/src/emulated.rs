//! A GigE Vision camera that is a program of its own.

use std::io::ErrorKind;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

const PROGRAM: &str = "arv-fake-gv-camera-0.8";

/// Where it listens, in a network namespace of its own.
pub const ADDRESS: &str = "127.0.0.1";

/// The running program; killed when dropped.
pub struct EmulatedCamera {
    program: Child,
}

impl EmulatedCamera {
    /// Starts the camera `serial`, which loses `lost_per_thousand` of its packets, and waits until it listens.
    pub fn start(serial: &str, lost_per_thousand: impl Into<f64>) -> Self {
        let lost = lost_per_thousand.into().to_string();
        let program = Command::new(PROGRAM)
            .args(["-i", ADDRESS, "-s", serial, "-r", &lost])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap_or_else(|error| match error.kind() {
                ErrorKind::NotFound => panic!("{PROGRAM} is not installed: install the package aravis-tools"),
                _ => panic!("{PROGRAM}: {error}"),
            });
        let mut camera = EmulatedCamera { program };
        let deadline = Instant::now() + Duration::from_secs(10);
        while !is_listening() {
            let exit = camera.program.try_wait().unwrap();
            assert!(exit.is_none(), "{PROGRAM} ended: {exit:?}");
            assert!(Instant::now() < deadline, "{PROGRAM} does not listen");
            thread::sleep(Duration::from_millis(5));
        }
        camera
    }
}

impl Drop for EmulatedCamera {
    fn drop(&mut self) {
        self.program.kill().unwrap();
        self.program.wait().unwrap();
    }
}

/// Whether the control port of GigE Vision (GVCP, UDP port 3956) is open.
fn is_listening() -> bool {
    let sockets = std::fs::read_to_string("/proc/net/udp").unwrap();
    let port = format!(":{:04X}", 3956);
    sockets.lines().filter_map(|line| line.split_whitespace().nth(1)).any(|local| local.ends_with(&port))
}
