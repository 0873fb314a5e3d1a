//! `uvcam run`: the driver.

use std::path::Path;
use std::time::Duration;

use crate::args;
use crate::engine::{self, Role};
use crate::error::Error;
use crate::exit::Exit;
use crate::processes;

pub(super) fn execute(arguments: &args::Run, file: Option<&Path>) -> Result<Exit, Error> {
    if let (Some(camera), Some(main_process)) = (&arguments.camera, arguments.main_process) {
        return processes::run_part(camera, main_process, file);
    }
    let config = super::load(file)?;
    let duration = arguments.duration.map(Duration::from_secs_f64);
    match config.process_per_camera {
        true => processes::run(&config, file, duration),
        false => engine::run(&config, duration, Role::Driver),
    }
}
