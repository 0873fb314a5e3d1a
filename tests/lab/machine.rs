//! The virtual machine: boots, shows its console, and tells how the tests ended.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

const EMULATOR: &str = "qemu-system-x86_64";
/// Longest run of all tests; a machine that hangs must not hang its host.
const PATIENCE: Duration = Duration::from_secs(1800);
/// The guest's last line, with the status of its tests behind it.
const EXIT: &str = "lab: exit ";

/// What came out of the machine.
pub struct Report {
    /// Whether every test passed.
    pub passed: bool,
    /// One sentence about the run.
    pub verdict: String,
    /// The lines that tests wrote as rows of a table: those that begin with `|`.
    pub table: Vec<String>,
}

/// Boots `kernel` with the file system `image`, with udevd or without, and runs the tests that `tests` chooses, as arguments of a test
/// program do.
pub fn run(kernel: &Path, image: &Path, tests: &str, has_udevd: bool) -> Report {
    let start = Instant::now();
    let mut machine = Command::new(EMULATOR)
        // Software emulation: the same machine on every host, and none of the host's devices.
        .args(["-accel", "tcg,thread=single", "-machine", "pc", "-cpu", "max", "-m", "2048"])
        // The guest's clock counts its instructions, one a nanosecond, and skips what it idles: a busy host does not make it late.
        .args(["-icount", "shift=0,sleep=off"])
        .args(["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"])
        .arg("-kernel")
        .arg(kernel)
        .arg("-initrd")
        .arg(image)
        .arg("-append")
        .arg(format!(
            "console=ttyS0 loglevel=3 mitigations=off panic=-1 nokaslr lab.udevd={} lab.tests=\"{tests}\"",
            if has_udevd { "yes" } else { "no" }
        ))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{EMULATOR}: {error}; install the package qemu-system-x86"));
    let console = BufReader::new(machine.stdout.take().unwrap());
    let (line_sender, lines) = channel();
    std::thread::spawn(move || {
        for line in console.split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line).trim_end().to_owned();
            if line_sender.send(line).is_err() {
                break;
            }
        }
    });

    let mut report = Report { passed: false, verdict: String::new(), table: Vec::new() };
    let mut status = None;
    loop {
        match lines.recv_timeout(PATIENCE.saturating_sub(start.elapsed())) {
            Ok(line) => {
                println!("{line}");
                if let Some(text) = line.strip_prefix(EXIT) {
                    status = Some(text.to_owned());
                }
                if line.starts_with('|') {
                    report.table.push(line);
                }
            }
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {
                report.verdict = format!("the machine did not end within {} s", PATIENCE.as_secs());
                machine.kill().unwrap();
                break;
            }
        }
    }
    machine.wait().unwrap();
    let seconds = start.elapsed().as_secs();
    report.passed = status.as_deref() == Some("0") && report.verdict.is_empty();
    if report.verdict.is_empty() {
        report.verdict = match status {
            Some(status) if status == "0" => format!("every test passed, {seconds} s"),
            Some(status) => format!("tests failed with exit status {status}, {seconds} s"),
            None => format!("the machine ended without a result, {seconds} s"),
        };
    }
    report
}
