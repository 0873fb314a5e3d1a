//! The process of one camera, as the main process sees it.

use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use uvcam_shm_ipc::Settings;
use uvcam_shm_ipc::health::{Cause, Health, HealthReader, State};

use super::launcher::Launcher;
use super::stderr::Stderr;
use crate::back_off::BackOff;
use crate::causes::with_causes;
use crate::exit::Exit;
use crate::service_manager::Condition;

/// A process writes a record every second. One that has not done so for this long hangs.
const SILENT: Duration = Duration::from_secs(5);
/// A process that has said nothing at all for this long hangs as well; at its start, it may wait for a predecessor to go.
const DUMB: Duration = Duration::from_secs(10);
/// A process that has worked for this long is started again at once.
const STEADY: Duration = Duration::from_secs(1);
/// How long what a process has said last may take to be told, before its end is. What it has started may hold its stderr open.
const LAST_WORDS: Duration = Duration::from_millis(50);
/// A camera that streams for this long works; what its processes did before is forgotten by the log.
const WORKING: Duration = Duration::from_secs(10);

/// A camera and its process.
pub(super) struct CameraProcess {
    name: String,
    process: Process,
    /// Where its health is told; missing before it has told any.
    reader: Option<HealthReader>,
    /// The newest record of the process that runs.
    record: Option<Health>,
    /// When that came, or when there was reason to begin to wait for it.
    heard: Instant,
    /// When the process that ran last was started.
    began: Instant,
    back_off: BackOff,
    /// Whether the camera has ever published.
    has_worked: bool,
    /// Whether its first attempt to open the camera is over, or took too long.
    is_tried: bool,
    /// Frames that its former processes have published.
    published_before: u64,
    /// Whether the masks are to be read anew by a process that does not listen yet.
    is_mask_owed: bool,
    stderr: Stderr,
}

/// What there is of a process.
enum Process {
    Running(Child),
    /// None runs until the camera is tried again, if it ever is.
    Ended {
        how: End,
        again: Option<Instant>,
    },
}

enum End {
    NotStarted,
    Status(ExitStatus),
}

impl CameraProcess {
    /// A camera whose process is to be started.
    pub(super) fn new(name: &str) -> Self {
        let now = Instant::now();
        CameraProcess {
            name: name.to_owned(),
            process: Process::Ended { how: End::NotStarted, again: Some(now) },
            reader: None,
            record: None,
            heard: now,
            began: now,
            back_off: BackOff::default(),
            has_worked: false,
            is_tried: false,
            published_before: 0,
            is_mask_owed: false,
            stderr: Stderr::new(name),
        }
    }

    /// Starts the process, where none runs and it is time for one.
    pub(super) fn start_where_due(&mut self, launcher: &Launcher<'_>, now: Instant) {
        if !matches!(self.process, Process::Ended { again: Some(again), .. } if now >= again) {
            return;
        }
        (self.began, self.heard) = (now, now);
        // It reads its mask at its start.
        self.is_mask_owed = false;
        self.process = match launcher.start(&self.name, &mut self.stderr) {
            Ok(child) => Process::Running(child),
            Err(error) => {
                self.is_tried = true;
                self.stderr.say(&with_causes(&error));
                let again = Some(now + self.back_off.after_failure(now, now));
                Process::Ended { how: End::NotStarted, again }
            }
        };
    }

    /// Reads what the process has told of the camera since.
    pub(super) fn look(&mut self, settings: &Settings, now: Instant) {
        if !self.is_running() {
            return;
        }
        if self.reader.is_none() {
            // One that is full, or of another user, tells nothing: that is no reason to take it for a process that hangs.
            self.reader = HealthReader::open(settings, &self.name)
                .inspect_err(|error| tracing::debug!("{}: {error}", self.name))
                .ok()
                .flatten();
        }
        self.listen(now);
        self.is_tried |= now.duration_since(self.began) > DUMB;
    }

    fn listen(&mut self, now: Instant) {
        let Process::Running(child) = &self.process else { return };
        let newest = self.reader.as_mut().and_then(|reader| reader.newest().ok().flatten());
        // What a predecessor has left is no news.
        let Some(record) = newest.filter(|record| record.process_id == child.id()) else { return };
        self.heard = now;
        self.has_worked |= has_worked(&record);
        if streams_for(&record, WORKING) {
            self.stderr.set_working(WORKING);
        }
        self.is_tried |= record.state() != Ok(State::Starting);
        self.record = Some(record);
        if std::mem::take(&mut self.is_mask_owed) {
            self.signal(Signal::HUP);
        }
    }

    /// Begins anew to wait for what the process says.
    pub(super) fn listen_anew(&mut self, now: Instant) {
        self.heard = now;
    }

    /// Why the process has to be killed: it, or its camera's thread, is stuck, and does not come back by itself.
    fn stuck(&self) -> Option<&'static str> {
        if !self.is_running() {
            return None;
        }
        let silence = self.heard.elapsed();
        let is_silent = match self.record {
            None => silence > DUMB,
            // Without a connection it may well fly, and not be able to tell, as its files were removed.
            Some(_) => self.reader.as_ref().is_some_and(HealthReader::is_connected) && silence > SILENT,
        };
        match &self.record {
            _ if is_silent => Some("its process says nothing any more"),
            Some(record) if is_stuck(record) => Some("a call into its library does not return"),
            _ => None,
        }
    }

    /// Kills the process where that is the only way on.
    pub(super) fn kill_where_hung(&mut self) {
        if let Some(why) = self.stuck() {
            self.kill(why);
        }
    }

    /// Kills the process, which is taken note of when it has ended.
    pub(super) fn kill(&mut self, why: &str) {
        self.stderr.say(&format!("{why}: its process is killed"));
        self.signal(Signal::KILL);
    }

    /// Takes note where the process has ended. Returns whether it has.
    pub(super) fn reap(&mut self, now: Instant) -> bool {
        // What it said last is gone when its place was cleaned up.
        self.listen(now);
        let Some(status) = self.reap_quietly() else { return false };
        let record = self.record.take();
        self.published_before += record.map_or(0, |record| record.published);
        self.is_tried = true;
        self.stderr.finish(Instant::now() + LAST_WORDS);
        self.stderr.set_failing();
        let is_wrong = status.code() == Some(Exit::Usage as i32);
        let has_worked = record.is_some_and(|record| has_worked(&record));
        if has_worked {
            self.back_off.forget();
        }
        let again = match () {
            () if is_wrong => None,
            // One that ends by itself may have been told so with all others, which will be known in a moment.
            () if has_worked && status.code().is_none() && now.duration_since(self.began) > STEADY => {
                Some(now)
            }
            () => Some(now + self.back_off.after_failure(self.began, now)),
        };
        self.process = Process::Ended { how: End::Status(status), again };
        let what_now = if is_wrong { "not started again" } else { "started again" };
        self.stderr.say(&format!("its process has ended ({status}), and is {what_now}"));
        true
    }

    /// The same, where it is not to be started again.
    pub(super) fn reap_quietly(&mut self) -> Option<ExitStatus> {
        let Process::Running(child) = &mut self.process else { return None };
        // An error means that it is no child, which cannot be.
        let status = child.try_wait().ok().flatten()?;
        self.process = Process::Ended { how: End::Status(status), again: None };
        Some(status)
    }

    /// Has the mask read anew.
    pub(super) fn read_mask(&mut self) {
        match self.record {
            Some(_) => self.signal(Signal::HUP),
            None => self.is_mask_owed = true,
        }
    }

    /// Asks the process to end.
    pub(super) fn stop(&self) {
        self.signal(Signal::TERM);
    }

    fn signal(&self, signal: Signal) {
        if let Process::Running(child) = &self.process {
            // One that has ended and was not waited for keeps its number.
            let _ = kill_process(Pid::from_child(child), signal);
        }
    }

    /// Waits until all is told that the process has said.
    pub(super) fn finish(&self, end: Instant) {
        self.stderr.finish(end);
    }

    /// Whether there is a process.
    pub(super) fn is_running(&self) -> bool {
        matches!(self.process, Process::Running(_))
    }

    /// Whether there is a process that has told nothing yet.
    pub(super) fn is_starting(&self) -> bool {
        self.is_running() && self.record.is_none()
    }

    /// A camera that never worked and does not work now. One that has worked is waited for.
    pub(super) fn is_hopeless(&self) -> bool {
        match (&self.process, &self.record) {
            (Process::Ended { again: None, .. }, _) => true,
            (Process::Ended { .. }, _) => self.is_tried && !self.has_worked,
            (Process::Running(_), Some(record)) => match record.state() {
                Ok(State::Refused) => true,
                Ok(State::Reconnecting) => !is_stuck(record) && !self.has_worked,
                _ => false,
            },
            (Process::Running(_), None) => false,
        }
    }

    /// How the process has ended.
    pub(super) fn exit(&self) -> Exit {
        match &self.process {
            Process::Ended { how: End::Status(status), .. } => match (status.code(), status.signal()) {
                (Some(code), _) => u8::try_from(code).map_or(Exit::System, Exit::from_code),
                // It was asked to before it could listen.
                (None, Some(signal)) if signal == Signal::TERM.as_raw() => Exit::Done,
                (None, _) => Exit::System,
            },
            Process::Ended { how: End::NotStarted, .. } | Process::Running(_) => Exit::System,
        }
    }

    /// What a service manager hears of the camera.
    pub(super) fn condition(&self) -> Condition {
        let name = &self.name;
        let is_stuck = self.stuck().is_some();
        let words = match (&self.process, &self.record) {
            _ if is_stuck => format!("{name} stuck"),
            (Process::Ended { how: End::Status(status), .. }, _) => format!("{name} ended ({status})"),
            (Process::Ended { how: End::NotStarted, .. } | Process::Running(_), None) => {
                format!("{name} starting")
            }
            (_, Some(record)) => describe(name, record),
        };
        let published = self.published_before + self.record.map_or(0, |record| record.published);
        Condition { published, is_tried: self.is_tried, is_stuck, words }
    }

    /// The camera in a few words.
    pub(super) fn status(&self) -> String {
        let (rate, lost) = self.record.map_or((0.0, 0), |record| (record.frame_rate, record.lost));
        format!("{} {rate:.0} fps, {lost} lost", self.name)
    }
}

fn has_worked(record: &Health) -> bool {
    record.published > 0 || record.state() == Ok(State::Streaming)
}

fn streams_for(record: &Health, long: Duration) -> bool {
    let since = record.written_monotonic_ns.saturating_sub(record.state_since_monotonic_ns);
    record.state() == Ok(State::Streaming) && Duration::from_nanos(since) >= long
}

fn is_stuck(record: &Health) -> bool {
    record.state() == Ok(State::Reconnecting) && record.cause() == Ok(Cause::Stuck)
}

/// What a process tells of its camera, in a few words.
fn describe(name: &str, record: &Health) -> String {
    match record.state() {
        Ok(State::Streaming) => format!("{name} streaming, {} lost", record.lost),
        Ok(state @ (State::Reconnecting | State::Refused)) => {
            format!("{name} {}: {}", state.as_str(), record.last_error())
        }
        Ok(state) => format!("{name} {}", state.as_str()),
        Err(error) => format!("{name} {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera whose process has ended with this status, as wait(2) gives it.
    fn ended(status: i32) -> CameraProcess {
        let again = Some(Instant::now());
        let process = Process::Ended { how: End::Status(ExitStatus::from_raw(status)), again };
        CameraProcess { process, is_tried: true, ..CameraProcess::new("left") }
    }

    #[test]
    fn the_code_of_a_process_is_the_driver_s_and_what_was_killed_has_failed() {
        let by_code = |code: i32| ended(code << 8).exit();
        assert_eq!([0, 2, 4, 5].map(by_code), [Exit::Done, Exit::Usage, Exit::Camera, Exit::SharedMemory]);
        assert_eq!(by_code(101), Exit::System);
        // SIGABRT, SIGKILL, SIGSEGV; SIGTERM, of one that did not listen yet.
        assert_eq!([6, 9, 11, 15].map(|signal| ended(signal).exit()), {
            [Exit::System, Exit::System, Exit::System, Exit::Done]
        });
        assert_eq!(CameraProcess::new("left").exit(), Exit::System);
    }

    #[test]
    fn a_camera_is_hopeless_that_never_worked_or_whose_configuration_is_wrong() {
        assert!(!CameraProcess::new("left").is_hopeless(), "it was not tried yet");
        assert!(ended(4 << 8).is_hopeless());
        let worked = CameraProcess { has_worked: true, ..ended(11) };
        assert!(!worked.is_hopeless(), "it is waited for");
        let process = Process::Ended { how: End::Status(ExitStatus::from_raw(2 << 8)), again: None };
        assert!(CameraProcess { process, ..worked }.is_hopeless());
    }

    #[test]
    fn a_service_manager_hears_of_each_state_in_a_few_words() {
        let record = |state: State, error: &str| {
            let mut record = Health::new();
            (record.state, record.lost) = (state as u32, 7);
            record.set_last_error(error);
            describe("left", &record)
        };
        assert_eq!(record(State::Streaming, ""), "left streaming, 7 lost");
        assert_eq!(record(State::Refused, "mask refused"), "left refused: mask refused");
        assert_eq!(record(State::Reconnecting, "gone"), "left reconnecting: gone");
        assert_eq!(record(State::Generating, ""), "left generating");
        let mut unknown = Health::new();
        unknown.state = 99;
        assert_eq!(describe("left", &unknown), "left state 99 is none of 1 to 6");
        assert_eq!(CameraProcess::new("left").condition().words, "left starting");
        assert_eq!(ended(11).condition().words, "left ended (signal: 11 (SIGSEGV))");
    }
}
