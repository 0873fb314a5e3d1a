//! The commands, one file each. Status goes to stderr, data to stdout.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGINT, SIGTERM};

use crate::args::{Arguments, Command};
use crate::config::{self, Config};
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::log;

mod demo;
mod doctor;
mod generate;
mod list;
mod mask;
mod run;
mod stats;
mod table;
mod watch;

/// Does what the command line asks, and says how it ended.
pub fn execute(arguments: Arguments) -> Exit {
    if let Err(source) = log::start() {
        let error = Error::System { doing: "starting thread", path: "log".into(), source };
        // Nothing flies yet, so that nothing waits for stderr. Where it takes nothing, the exit code tells.
        let _ = writeln!(std::io::stderr(), "uvcam: {}", with_causes(&error));
        return error.exit();
    }
    let exit = dispatch(arguments).unwrap_or_else(|error| {
        tracing::error!("{}", with_causes(&error));
        error.exit()
    });
    log::flush();
    exit
}

fn dispatch(arguments: Arguments) -> Result<Exit, Error> {
    let file = arguments.config.as_deref();
    match arguments.command {
        Command::Run(run) => run::execute(&run, file),
        Command::List(list) => list::execute(&list),
        Command::Watch(watch) => load(file).and_then(|config| watch::execute(&watch, &config)),
        Command::Stats(stats) => load(file).and_then(|config| stats::execute(&stats, &config)),
        Command::Generate(generate) => generate::execute(&generate, || load(file)),
        Command::Mask(mask) => mask::execute(&mask, || load(file)),
        Command::Doctor(doctor) => load(file).and_then(|config| doctor::execute(&doctor, &config)),
        Command::Config => print(config::DEFAULT.trim_end()).map(|()| Exit::Done),
        Command::Demo(demo) => demo::execute(&demo),
    }
}

fn load(file: Option<&Path>) -> Result<Config, Error> {
    Ok(Config::load(file)?)
}

/// A flag that SIGINT and SIGTERM set.
fn stop_flag() -> Result<Arc<AtomicBool>, Error> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).map_err(|source| Error::System {
            doing: "listening to",
            path: "signals".into(),
            source,
        })?;
    }
    Ok(stop)
}

/// Prints data to stdout, after what was said on stderr. A reader that has seen enough and closed the pipe is no error.
fn print(text: &str) -> Result<(), Error> {
    log::flush();
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::System { doing: "writing to", path: "stdout".into(), source: error })
        }
        _ => Ok(()),
    }
}
