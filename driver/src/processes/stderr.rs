//! What is said of one camera: by its processes, on stderr, and by the main process about them.
//!
//! A process that ends over and over says the same at each start and at each end. So its lines come through the main process, on a thread
//! for each, and those of a camera that fails are told as all messages about a failing camera are: each once, and again at growing
//! distance. What is no line of our log, as a library writes it, or the runtime where a process ends, gets the camera's name.

use std::io::{BufRead, BufReader, PipeReader, Read, pipe};
use std::process::Stdio;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::error::Error;
use crate::log;
use crate::thread::spawn;
use crate::told::Told;

/// Different lines that may be told of a failing camera within a minute: what a process says at its start, and at its end.
const KEPT: usize = 32;
/// Time between looks at a thread that is to end.
const NAP: Duration = Duration::from_millis(1);

/// What is said of a camera.
pub(super) struct Stderr {
    camera: String,
    voice: Arc<Mutex<Voice>>,
    /// Reads what the process that was started last says.
    thread: Option<JoinHandle<()>>,
}

struct Voice {
    told: Told,
    /// Whether a process has ended since one has worked for long.
    is_failing: bool,
}

impl Stderr {
    pub(super) fn new(camera: &str) -> Self {
        let voice = Voice { told: Told::keeping(KEPT), is_failing: false };
        Stderr { camera: camera.to_owned(), voice: Arc::new(Mutex::new(voice)), thread: None }
    }

    /// The stderr of the next process: that of the main one where the system gives no pipe or no thread, which is no reason not to fly.
    pub(super) fn open(&mut self) -> Stdio {
        self.pipe().unwrap_or_else(|error| {
            tracing::debug!("{}: {error}", self.camera);
            Stdio::inherit()
        })
    }

    fn pipe(&mut self) -> Result<Stdio, Error> {
        let (reader, writer) = pipe().map_err(|source| Error::System {
            doing: "making the stderr of camera",
            path: self.camera.clone().into(),
            source,
        })?;
        let (camera, voice) = (self.camera.clone(), self.voice.clone());
        self.thread = Some(spawn(&format!("{camera}-stderr"), move || relay(reader, &camera, &voice))?);
        Ok(writer.into())
    }

    /// Says something of the camera's process, unless that is no news.
    pub(super) fn say(&self, text: &str) {
        if let Some(text) = self.voice().told.due(text, Instant::now()) {
            tracing::error!("{}: {text}", self.camera);
        }
    }

    /// Takes note that a process has ended.
    pub(super) fn set_failing(&self) {
        self.voice().is_failing = true;
    }

    /// Takes note that the camera has worked for so long that what it did before is forgotten.
    pub(super) fn set_working(&self, long: Duration) {
        let untold = {
            let mut voice = self.voice();
            voice.is_failing = false;
            voice.told.forget()
        };
        if untold > 0 {
            let seconds = long.as_secs();
            tracing::info!("{}: streaming for {seconds} s (messages not told before: {untold})", self.camera);
        }
    }

    /// Waits until all is told that the last process has said, until `end`: what that one has started may hold its stderr open for ever.
    pub(super) fn finish(&self, end: Instant) {
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < end {
            std::thread::sleep(NAP);
        }
    }

    fn voice(&self) -> MutexGuard<'_, Voice> {
        lock(&self.voice)
    }
}

fn lock(voice: &Mutex<Voice>) -> MutexGuard<'_, Voice> {
    // Valid whatever happened to another holder: a flag, and a list of messages.
    voice.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hands on what a process says, line by line, until its end. A line that is too long becomes several.
fn relay(reader: PipeReader, camera: &str, voice: &Mutex<Voice>) {
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    loop {
        line.clear();
        match reader.by_ref().take(log::LONGEST_LINE as u64).read_until(b'\n', &mut line) {
            // An error of a pipe is its end as well.
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end();
        let due = {
            let mut voice = lock(voice);
            match voice.is_failing {
                true => voice.told.due(text, Instant::now()),
                false => Some(text.to_owned()),
            }
        };
        match due {
            Some(text) if is_of_our_log(&text) => log::pass_on((text + "\n").as_bytes()),
            Some(text) if !text.is_empty() => tracing::warn!("{camera}: {text}"),
            _ => {}
        }
    }
}

/// Whether a line begins with a time, as those of our log do, be it in colour.
fn is_of_our_log(line: &str) -> bool {
    let line = line.strip_prefix("\x1b[2m").unwrap_or(line);
    let mut letters = line.chars();
    letters.by_ref().take(4).all(|letter| letter.is_ascii_digit()) && letters.next() == Some('-')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_our_log_are_known_by_their_time() {
        assert!(is_of_our_log("2026-11-25T19:09:20.123456Z  INFO left: streaming"));
        assert!(is_of_our_log(
            "\x1b[2m2026-11-25T19:09:20.123456Z\x1b[0m \x1b[32m INFO\x1b[0m left: streaming"
        ));
        for line in ["memory allocation of 16777216 bytes failed", "", "2026", "12-5"] {
            assert!(!is_of_our_log(line), "{line}");
        }
    }
}
