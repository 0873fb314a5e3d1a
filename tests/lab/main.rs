//! Boots a kernel that has cameras in a virtual machine, and runs the tests of `tests/guest` there. See README.md beside this file.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::PathBuf;
use std::process::ExitCode;

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

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let Some(folder) = arguments.next().map(PathBuf::from) else {
        eprintln!(
            "usage: lab FOLDER [TEST...]\nFOLDER holds an unpacked kernel package of Debian; `make lab` calls this"
        );
        return ExitCode::from(2);
    };
    let tests: Vec<String> = arguments.collect();
    let kernel = kernel::Kernel::find(&folder.join("kernel"));
    let image = guest_image::build(&folder.join("guest"), &kernel);
    let report = machine::run(&kernel.image, &image, &tests);
    if !report.table.is_empty() {
        println!("\n{}", report.table.join("\n"));
    }
    println!("\nlab: {}", report.verdict);
    match report.passed {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
