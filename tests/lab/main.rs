//! Boots a kernel that has cameras in a virtual machine, and runs the tests of `tests/guest` there. See README.md beside this file.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;

mod guest_image;
mod kernel;
mod machine;

/// The kernel's modules that tests use, with their parameters. What these depend on comes by itself.
const MODULES: [(&str, &str); 3] = [
    // Two video capture devices, no outputs, tuners or radios.
    ("vivid", "n_devs=2 node_types=0x1,0x1"),
    ("uvcvideo", ""),
    ("vhci-hcd", ""),
];

/// The module of tests for a machine without udevd; all others need one.
const WITHOUT_UDEVD: &str = "without_udevd";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let Some(folder) = arguments.next().map(PathBuf::from) else {
        eprintln!(
            "usage: lab FOLDER [TEST...]\nFOLDER holds an unpacked kernel package of Debian; `make lab` calls this"
        );
        return ExitCode::from(2);
    };
    let tests = arguments.collect::<Vec<_>>().join(" ");
    let kernel = kernel::Kernel::find(&folder.join("kernel"));
    let image = guest_image::build(&folder.join("guest"), &kernel);
    // They run beside each other; the first two take about as long as one another.
    let machines = match tests.as_str() {
        "" => vec![with_udevd("replug"), with_udevd("--skip replug"), without_udevd(WITHOUT_UDEVD)],
        tests if tests.contains(WITHOUT_UDEVD) => vec![without_udevd(tests)],
        tests => vec![with_udevd(tests)],
    };
    let report = |(tests, has_udevd): &(String, bool)| machine::run(&kernel.image, &image, tests, *has_udevd);
    let reports: Vec<_> = thread::scope(|scope| {
        let running: Vec<_> = machines.iter().map(|tests| scope.spawn(|| report(tests))).collect();
        running.into_iter().map(|machine| machine.join().unwrap()).collect()
    });
    let table: Vec<_> = reports.iter().flat_map(|report| report.table.iter().map(String::as_str)).collect();
    if !table.is_empty() {
        println!("\n{}", table.join("\n"));
    }
    println!();
    for ((tests, _), report) in machines.iter().zip(&reports) {
        println!("lab, {}: {}", tests, report.verdict);
    }
    match reports.iter().all(|report| report.passed) {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

/// A machine as most are, and the tests that it runs.
fn with_udevd(tests: &str) -> (String, bool) {
    (format!("{tests} --skip {WITHOUT_UDEVD}"), true)
}

/// A machine like a container, and the tests that it runs.
fn without_udevd(tests: &str) -> (String, bool) {
    (tests.to_owned(), false)
}
