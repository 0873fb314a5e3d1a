//! A GigE Vision camera on loopback: aravis' own, which is a program.

use std::io::ErrorKind;
use std::process::{Child, Command, Stdio};

use crate::wait_until;

const PROGRAM: &str = "arv-fake-gv-camera-0.8";

/// Where it listens. There is one to a network namespace: its ports are those of the standard.
pub const ADDRESS: &str = "127.0.0.1";

/// The running program. Dropping it kills it, without a word on the wire.
pub struct Camera {
    program: Child,
}

impl Camera {
    /// Starts the camera `serial`, which loses `lost_per_thousand` of its packets, and waits until it listens.
    ///
    /// # Panics
    /// Where the program is not installed, or another one has its port.
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
        let mut camera = Camera { program };
        wait_until("the GigE Vision camera listens", || {
            let exit = camera.program.try_wait().unwrap();
            assert!(exit.is_none(), "{PROGRAM} ended: {exit:?}");
            is_listening()
        });
        camera
    }
}

impl Drop for Camera {
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
