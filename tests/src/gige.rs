//! A GigE Vision camera that is not ours: the program `arv-fake-gv-camera-0.8` of the package aravis-tools, on the loopback of a
//! network namespace of the test's own.

use std::process::{Command, Stdio};

use crate::Process;

/// The program, from package `aravis-tools`.
const CAMERA: &str = "arv-fake-gv-camera-0.8";
/// Set in the process that is inside the namespace.
const INSIDE: &str = "UVCAM_TEST_INSIDE_NAMESPACE";

/// Runs `test` of the calling test binary again inside a new network namespace, and returns whether this is that run.
///
/// # Panics
/// Where the namespace cannot be made, or where the test failed inside it.
pub fn inside_namespace(test: &str) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    // Root makes the namespace by itself; anyone else becomes root of a user namespace for it.
    let privileges = if rustix::process::geteuid().is_root() { "-n" } else { "-rn" };
    let script = "ip link set lo up && ip route add default dev lo && exec \"$0\" \"$@\"";
    let status = Command::new("unshare")
        .args([privileges, "sh", "-c", script])
        .arg(std::env::current_exe().unwrap())
        .args([test, "--exact", "--nocapture", "--test-threads", "1"])
        .env(INSIDE, "1")
        .status()
        .expect("unshare (package util-linux) makes the network namespace of this test");
    assert!(status.success(), "{test} failed inside its network namespace");
    false
}

/// Starts the camera with this serial on 127.0.0.1, inside the namespace.
pub fn start_camera(serial: &str, options: &[&str]) -> Process {
    assert!(
        std::env::var_os(INSIDE).is_some(),
        "a GigE Vision camera answers on every network: start it in a namespace"
    );
    let mut command = Command::new(CAMERA);
    command.args(["-i", "127.0.0.1", "-s", serial]).args(options).stdin(Stdio::null());
    let found =
        Command::new("which").arg(CAMERA).stdout(Stdio::null()).status().is_ok_and(|status| status.success());
    assert!(found, "{CAMERA} is missing: install package aravis-tools");
    Process::start(&mut command)
}
