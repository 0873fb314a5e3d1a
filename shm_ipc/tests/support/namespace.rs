//! A `/dev/shm` of a test's own: this program, executed again in a mount namespace.

use std::process::{Command, Stdio};

/// Tells the program that it is in its namespace.
const INSIDE: &str = "UVCAM_TEST_IN_MOUNT_NAMESPACE";

/// Runs `body` of the test `name` where `/dev/shm` is a new tmpfs with these options of mount(8).
pub fn with_shared_memory(options: &str, name: &str, body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        return body();
    }
    // Root makes a mount namespace; anyone else needs a user namespace around it.
    let plain = Command::new("unshare").args(["--mount", "true"]).stderr(Stdio::null()).status();
    let namespace: &[&str] = match plain.is_ok_and(|status| status.success()) {
        true => &["--mount"],
        false => &["--mount", "--map-root-user"],
    };
    let output = Command::new("unshare")
        .args(namespace)
        .args(["sh", "-c", "mount -t tmpfs -o \"$0\" tmpfs /dev/shm && exec \"$@\"", options])
        .arg(std::env::current_exe().unwrap())
        .args([name, "--exact", "--nocapture"])
        .env(INSIDE, "1")
        .output()
        .expect("unshare: install the package util-linux");
    let said = String::from_utf8_lossy(&output.stdout);
    // A wrong name runs no test, successfully.
    let ran = output.status.success() && said.contains("1 passed");
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(ran, "{name} failed in its namespace: {}\n{said}\n{complained}", output.status);
}
