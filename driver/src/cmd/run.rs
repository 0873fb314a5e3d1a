//! `uvcam run`: the driver.

use std::time::Duration;

use crate::args;
use crate::config::Config;
use crate::engine;
use crate::error::Error;
use crate::exit::Exit;

pub(super) fn execute(arguments: &args::Run, config: &Config) -> Result<Exit, Error> {
    engine::run(config, arguments.duration.map(Duration::from_secs_f64))
}
