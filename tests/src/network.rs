//! Each test that opens a port runs in a network namespace of its own: this program, executed again.

use std::process::Command;

use crate::namespace;

/// Tells the program that it is in its namespace.
const INSIDE: &str = "UVCAM_TEST_IN_NETWORK_NAMESPACE";

/// Runs `body` of the test `name` (its path in this program) in a namespace in which only loopback is up.
pub fn in_namespace(name: &str, body: impl FnOnce()) {
    in_namespace_without(&[], name, body);
}

/// Like [`in_namespace`], without the capability CAP_NET_RAW.
pub fn in_namespace_without_net_raw(name: &str, body: impl FnOnce()) {
    in_namespace_without(&["setpriv", "--bounding-set=-net_raw", "--inh-caps=-net_raw"], name, body);
}

fn in_namespace_without(wrapper: &[&str], name: &str, body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        return body();
    }
    let program = std::env::current_exe().unwrap();
    let output = Command::new("unshare")
        .args(namespace::options(&["--net"]))
        .args(["sh", "-c", "ip link set lo up && exec \"$@\"", "sh"])
        .args(wrapper)
        .arg(program)
        .args([name, "--exact", "--nocapture"])
        .env(INSIDE, "1")
        .output()
        .expect("unshare: install the packages util-linux and iproute2");
    let (said, complained) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    // A wrong name runs no test, successfully.
    let ran = output.status.success() && said.contains("1 passed");
    assert!(ran, "{name} failed in its network namespace: {}\n{said}\n{complained}", output.status);
    print!("{said}");
}

/// Runs this program again, in a namespace in which only loopback is up; returns where it is there already.
pub fn enter_namespace() {
    if std::env::var_os(INSIDE).is_some() {
        return;
    }
    let status = Command::new("unshare")
        .args(namespace::options(&["--net"]))
        .args(["sh", "-c", "ip link set lo up && exec \"$@\"", "sh"])
        .arg(std::env::current_exe().unwrap())
        .env(INSIDE, "1")
        .status()
        .expect("unshare: install the packages util-linux and iproute2");
    std::process::exit(status.code().unwrap_or(1));
}
