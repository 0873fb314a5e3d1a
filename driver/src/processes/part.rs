//! The process of one camera, from its own side.

use std::fs;
use std::io::Read;
use std::path::Path;

use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};

use crate::config::Config;
use crate::engine::{self, Role};
use crate::error::Error;
use crate::exit::Exit;
use crate::memory;

/// Where the kernel is told whom to end first where memory is short (proc_pid_oom_score_adj(5)).
const OOM_SCORE: &str = "/proc/self/oom_score_adj";
/// How much sooner than the main process: a tenth of what the machine's whole memory counts.
const SOONER: i32 = 100;
const LARGEST_OOM_SCORE: i32 = 1000;
/// Longest configuration, bytes: as the main process has read it.
const LONGEST: u64 = 1 << 20;

/// Runs this camera of the configuration on stdin, whose file was `file`, until the process `main_process` that has started this one says
/// otherwise, or ends.
///
/// # Errors
/// [`Error::Usage`] where no main process has started this one, and those of [`engine::run`].
pub(crate) fn run(camera: &str, main_process: u32, file: Option<&Path>) -> Result<Exit, Error> {
    end_with(main_process)?;
    // By the file that it was started from, which is a link, it would be called "exe". A name is for whoever looks at processes.
    let _ = rustix::thread::set_name(c"uvcam");
    come_before_the_main_process_where_memory_is_short();
    let mut text = Vec::new();
    std::io::stdin().lock().take(LONGEST).read_to_end(&mut text).map_err(|source| Error::System {
        doing: "reading the configuration from",
        path: "stdin".into(),
        source,
    })?;
    let config = Config::handed_over(&text, file)?;
    let config = config.with_only(camera).ok_or_else(|| not_by_hand(camera))?;
    memory::bound(config.process_memory_bytes);
    engine::run(&config, None, Role::Part)
}

/// Lets this process be killed when its parent ends, however that happens, and makes sure that it has not ended before.
fn end_with(main_process: u32) -> Result<(), Error> {
    set_parent_process_death_signal(Some(Signal::KILL)).map_err(|error| Error::System {
        doing: "asking for the end of",
        path: "the main process".into(),
        source: error.into(),
    })?;
    let parent = getppid().and_then(|parent| u32::try_from(Pid::as_raw(Some(parent))).ok());
    match parent == Some(main_process) {
        true => Ok(()),
        false => Err(not_by_hand(&format!("of process {main_process}"))),
    }
}

fn not_by_hand(camera: &str) -> Error {
    Error::Usage(format!(
        "camera {camera}: a driver starts the processes of its cameras itself; write `uvcam run`"
    ))
}

/// The process of a camera that takes all memory is the one to end: not a sibling, and not the one that starts it again.
fn come_before_the_main_process_where_memory_is_short() {
    let inherited = fs::read_to_string(OOM_SCORE).ok().and_then(|score| score.trim().parse::<i32>().ok());
    if let Some(inherited) = inherited {
        let score = inherited.saturating_add(SOONER).min(LARGEST_OOM_SCORE);
        // A system that does not permit it chooses by memory alone.
        let _ = fs::write(OOM_SCORE, score.to_string());
    }
}
