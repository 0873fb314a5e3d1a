//! Starts the process of a camera: this very program, with the configuration that was read once.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, IsTerminal, Seek, Write};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command};

use rustix::fs::{MemfdFlags, memfd_create};

use super::stderr::Stderr;
use crate::config::Config;
use crate::error::Error;
use crate::log;

/// This program, also where another one has taken its file's place.
const PROGRAM: &str = "/proc/self/exe";
/// What the service manager says to the main process alone.
const OF_THE_MANAGER: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

/// What all processes of cameras have in common.
pub(super) struct Launcher<'a> {
    /// The configuration's text: a process that starts in flight finds what the others found, whoever works on the file.
    text: &'a str,
    file: Option<&'a Path>,
    /// What the program is called.
    name: OsString,
}

impl<'a> Launcher<'a> {
    pub(super) fn new(config: &'a Config, file: Option<&'a Path>) -> Self {
        let name = std::env::args_os().next().unwrap_or_else(|| "uvcam".into());
        Launcher { text: &config.text, file, name }
    }

    /// Starts the process of this camera, which says there what it has to say.
    ///
    /// # Errors
    /// [`Error::System`] where the system gives none.
    pub(super) fn start(&self, camera: &str, stderr: &mut Stderr) -> Result<Child, Error> {
        let mut command = Command::new(PROGRAM);
        command.arg0(&self.name).args(["run", "--camera", camera, "--main-process"]);
        command.arg(std::process::id().to_string());
        if let Some(file) = self.file {
            command.arg("--config").arg(file);
        }
        for name in OF_THE_MANAGER {
            command.env_remove(name);
        }
        if io::stderr().is_terminal() {
            command.env(log::IN_COLOUR, "1");
        }
        // In this order: where there are few files to be had, what tells is not at the cost of what flies.
        let text = self.text_as_file();
        text.and_then(|text| command.stdin(text).stderr(stderr.open()).spawn()).map_err(|source| {
            Error::System { doing: "starting the process of camera", path: camera.into(), source }
        })
    }

    /// The text as a file without a name, which a process that does not read it does not hold up.
    fn text_as_file(&self) -> io::Result<File> {
        let mut file = File::from(memfd_create("uvcam.toml", MemfdFlags::CLOEXEC)?);
        file.write_all(self.text.as_bytes())?;
        file.rewind()?;
        Ok(file)
    }
}
