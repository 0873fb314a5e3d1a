//! `uvcam`: parses the command line and hands it to the library.

use std::process::ExitCode;

use clap::Parser;
use uvcam::args::Arguments;

fn main() -> ExitCode {
    uvcam::cmd::execute(Arguments::parse()).into()
}
