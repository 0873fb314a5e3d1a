//! What the program says on stderr, written by a thread of its own.
//!
//! stderr may be a full disk, a terminal that was closed, or a pipe that nobody reads: a write fails, or waits for ever. No thread that
//! flies may do either. So this thread alone writes there what the log, the status line, panics and libraries have to say. Lines wait for
//! it in a bounded queue; those that do not fit, or cannot be written, are counted, and their number is told as soon as a line can be
//! written again.
//!
//! What is the same each time, said at each opening of a camera, is told as messages about a failing one are: once, and again at growing
//! distance.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::panic::PanicHookInfo;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use tracing::Metadata;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::MakeWriter;

use crate::camera::kinds;
use crate::told::{OPENING, Told};

/// Where the output of this program goes to a terminal by the hands of another one, which says so by this variable.
pub(crate) const IN_COLOUR: &str = "CLICOLOR_FORCE";

/// Lines that may wait for stderr, and the longest of them in bytes; a longer one is cut.
const WAITING: usize = 1024;
pub(crate) const LONGEST_LINE: usize = 16 * 1024;
/// Different lines that may be told of the openings of all cameras within a minute.
const OPENINGS: usize = 64;
/// How long [`flush`] waits for them.
const PATIENCE: Duration = Duration::from_millis(500);
/// Time between two checks for room.
const NAP: Duration = Duration::from_millis(2);
/// Stack of the writing thread, bytes.
const STACK: usize = 256 * 1024;

static QUEUE: OnceLock<Queue> = OnceLock::new();

/// The way to the writing thread. Its two ends: [`Queue::new`].
struct Queue {
    items: SyncSender<Item>,
    /// Lines dropped since one last found room in the queue. A number for display: `Relaxed`.
    dropped: AtomicU64,
    /// What was said at openings of cameras.
    openings: Mutex<Told>,
}

enum Item {
    /// A line, and how many before it were dropped.
    Line { text: Vec<u8>, dropped: u64 },
    /// The status of the moment; worth nothing later.
    Status(Vec<u8>),
    /// Tells that everything before it was written, after so many lines were dropped.
    Flush { done: SyncSender<()>, dropped: u64 },
}

/// Starts the writing thread, and sends it the log, panics, and what libraries say.
///
/// # Errors
/// Where the system starts no thread.
pub fn start() -> io::Result<()> {
    let (queue, inbox) = Queue::new();
    let writer = Writer::new(io::stderr());
    std::thread::Builder::new().name("log".into()).stack_size(STACK).spawn(move || writer.serve(&inbox))?;
    let queue = QUEUE.get_or_init(|| queue);
    let filter = EnvFilter::try_from_env("UVCAM_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(queue)
        .with_ansi(io::stderr().is_terminal() || std::env::var_os(IN_COLOUR).is_some())
        .with_target(false)
        .log_internal_errors(false)
        .init();
    std::panic::set_hook(Box::new(tell_panic));
    uvcam_shm_ipc::log_to(|text| tracing::warn!("{text}"));
    kinds::log_libraries();
    Ok(())
}

/// Shows a status line in place of the one before, where somebody looks at it.
pub fn show_status(line: &str) {
    if io::stderr().is_terminal()
        && let Some(queue) = QUEUE.get()
    {
        // One that finds no room is followed by another.
        let _ = queue.items.try_send(Item::Status(format!("\r\x1b[K{line}\r").into_bytes()));
    }
}

/// Takes a line that another process has finished, its end included.
pub(crate) fn pass_on(line: &[u8]) {
    if let Some(queue) = QUEUE.get() {
        queue.say(line);
    }
}

/// Waits until everything said before is written; not for a stderr that takes nothing.
pub fn flush() {
    if let Some(queue) = QUEUE.get() {
        queue.flush(PATIENCE);
    }
}

/// Logs a panic's message as any other. The main thread's is the last thing that the program says.
fn tell_panic(panic: &PanicHookInfo<'_>) {
    let thread = std::thread::current();
    let name = thread.name().unwrap_or("without a name");
    let backtrace = Backtrace::capture();
    match backtrace.status() {
        BacktraceStatus::Captured => tracing::error!("thread {name} {panic}\n{backtrace}"),
        _ => tracing::error!("thread {name} {panic}"),
    }
    if name == "main" {
        flush();
    }
}

impl Queue {
    fn new() -> (Self, Receiver<Item>) {
        let (items, inbox) = sync_channel(WAITING);
        (Queue { items, dropped: AtomicU64::new(0), openings: Mutex::new(Told::keeping(OPENINGS)) }, inbox)
    }

    /// What is said at each opening.
    fn say_at_opening(&self, line: &[u8]) {
        let text = String::from_utf8_lossy(line);
        // A list of messages is valid whatever happened to another holder.
        let mut openings = self.openings.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(text) = openings.due(text.trim_end(), Instant::now()) {
            self.say((text + "\n").as_bytes());
        }
    }

    fn say(&self, line: &[u8]) {
        let dropped = self.dropped.swap(0, Ordering::Relaxed);
        let text = line.get(..LONGEST_LINE).unwrap_or(line).to_vec();
        if self.items.try_send(Item::Line { text, dropped }).is_err() {
            self.dropped.fetch_add(dropped + 1, Ordering::Relaxed);
        }
    }

    fn flush(&self, patience: Duration) {
        let end = Instant::now() + patience;
        let (done, answer) = sync_channel(1);
        let dropped = self.dropped.swap(0, Ordering::Relaxed);
        while self.items.try_send(Item::Flush { done: done.clone(), dropped }).is_err() {
            if Instant::now() >= end {
                return;
            }
            std::thread::sleep(NAP);
        }
        // No answer in time: stderr takes nothing, and nobody is to wait for it.
        let _ = answer.recv_timeout(end.saturating_duration_since(Instant::now()));
    }
}

/// One line of the log, on its way into the queue.
struct Line<'a> {
    queue: &'a Queue,
    is_of_opening: bool,
}

impl Write for Line<'_> {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        match self.is_of_opening {
            true => self.queue.say_at_opening(line),
            false => self.queue.say(line),
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for &'static Queue {
    type Writer = Line<'a>;

    fn make_writer(&'a self) -> Self::Writer {
        Line { queue: self, is_of_opening: false }
    }

    fn make_writer_for(&'a self, metadata: &Metadata<'_>) -> Self::Writer {
        Line { queue: self, is_of_opening: metadata.target() == OPENING }
    }
}

/// The writing thread.
struct Writer<W> {
    to: W,
    /// Lines that are missing since the last one that was written.
    missing: u64,
    /// Whether the last write ended within its line.
    is_torn: bool,
}

impl<W: Write> Writer<W> {
    fn new(to: W) -> Self {
        Writer { to, missing: 0, is_torn: false }
    }

    fn serve(mut self, inbox: &Receiver<Item>) {
        for item in inbox {
            match item {
                Item::Line { text, dropped } => {
                    self.missing += dropped;
                    self.tell_missing();
                    if self.write(&text).is_err() {
                        self.missing += 1;
                    }
                }
                // The next one comes in a second.
                Item::Status(text) => drop(self.write(&text)),
                Item::Flush { done, dropped } => {
                    self.missing += dropped;
                    self.tell_missing();
                    // Who waited may have lost patience.
                    let _ = done.try_send(());
                }
            }
        }
    }

    fn tell_missing(&mut self) {
        if self.missing == 0 {
            return;
        }
        let end_of_line = if self.is_torn { "\n" } else { "" };
        let time = jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%S%.6fZ");
        let missing = self.missing;
        let notice =
            format!("{end_of_line}{time}  WARN {missing} log lines dropped: stderr did not take them\n");
        if self.write(notice.as_bytes()).is_ok() {
            self.missing = 0;
        }
    }

    /// Writes all of it, for as long as it takes: the queue does not wait.
    fn write(&mut self, mut text: &[u8]) -> io::Result<()> {
        while !text.is_empty() {
            match self.to.write(text) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(written) => {
                    text = text.get(written..).unwrap_or_default();
                    self.is_torn = !text.is_empty();
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // Another process has made the pipe or terminal non-blocking.
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(NAP),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// A stderr that answers each write as it is told, then takes everything.
    #[derive(Clone, Default)]
    struct Stderr {
        answers: Arc<Mutex<Vec<Result<usize, ErrorKind>>>>,
        text: Arc<Mutex<Vec<u8>>>,
    }

    impl Stderr {
        fn answering(answers: &[Result<usize, ErrorKind>]) -> Self {
            let stderr = Stderr::default();
            stderr.answers.lock().unwrap().extend(answers.iter().rev());
            stderr
        }

        fn lines(&self) -> Vec<String> {
            let text = String::from_utf8(self.text.lock().unwrap().clone()).unwrap();
            text.lines().map(|line| line.split("  WARN ").last().unwrap_or_default().to_owned()).collect()
        }
    }

    impl Write for Stderr {
        fn write(&mut self, text: &[u8]) -> io::Result<usize> {
            let answer = self.answers.lock().unwrap().pop().unwrap_or(Ok(text.len()));
            let taken = answer.map_err(io::Error::from)?.min(text.len());
            self.text.lock().unwrap().extend(&text[..taken]);
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// What is written of these lines, and then at a flush.
    fn written(stderr: &Stderr, lines: &[&str]) -> Vec<String> {
        let (queue, inbox) = Queue::new();
        for line in lines {
            queue.say(format!("{line}\n").as_bytes());
        }
        let (done, _) = sync_channel(1);
        let dropped = queue.dropped.load(Ordering::Relaxed);
        let sender = queue.items.clone();
        drop(queue);
        let writer = Writer::new(stderr.clone());
        std::thread::scope(|scope| {
            scope.spawn(move || writer.serve(&inbox));
            // Waits for room, unlike those who fly.
            sender.send(Item::Flush { done, dropped }).unwrap();
            drop(sender);
        });
        stderr.lines()
    }

    #[test]
    fn interrupted_refused_and_partial_writes_lose_nothing() {
        let answers = [Err(ErrorKind::Interrupted), Ok(2), Err(ErrorKind::WouldBlock), Ok(1)];
        assert_eq!(written(&Stderr::answering(&answers), &["one", "two"]), ["one", "two"]);
    }

    #[test]
    fn lines_that_cannot_be_written_are_counted_and_told_when_others_can() {
        for kind in [ErrorKind::BrokenPipe, ErrorKind::StorageFull, ErrorKind::Other, ErrorKind::WriteZero] {
            // Both lines fail, and the notice before the second one.
            let answers = [Err(kind), Err(kind), Err(kind)];
            assert_eq!(
                written(&Stderr::answering(&answers), &["one", "two", "three"]),
                ["2 log lines dropped: stderr did not take them", "three"]
            );
        }
        let always = [Err(ErrorKind::BrokenPipe); 64];
        assert!(written(&Stderr::answering(&always), &["one", "two"]).is_empty());
    }

    #[test]
    fn a_torn_line_ends_before_the_notice() {
        let answers = [Ok(2), Err(ErrorKind::StorageFull)];
        assert_eq!(
            written(&Stderr::answering(&answers), &["one", "two"]),
            ["on", "1 log lines dropped: stderr did not take them", "two"]
        );
    }

    #[test]
    fn what_is_the_same_at_each_opening_is_told_once() {
        let (queue, inbox) = Queue::new();
        let mut openings = Line { queue: &queue, is_of_opening: true };
        for line in ["12:00 copied once\n", "12:01 copied once\n", "12:02 at risk\n", "12:03 copied once\n"] {
            openings.write_all(line.as_bytes()).unwrap();
        }
        Line { queue: &queue, is_of_opening: false }.write_all(b"12:04 copied once\n").unwrap();
        let said: Vec<_> = std::iter::from_fn(|| inbox.try_recv().ok())
            .filter_map(|item| match item {
                Item::Line { text, .. } => String::from_utf8(text).ok(),
                _ => None,
            })
            .collect();
        assert_eq!(
            said,
            [
                "12:00 copied once\n",
                "12:02 at risk (not told since the last one: 1)\n",
                "12:04 copied once\n"
            ]
        );
    }

    #[test]
    fn a_full_queue_drops_and_counts_what_is_new() {
        let lines: Vec<String> = (0..WAITING + 7).map(|number| number.to_string()).collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let said = written(&Stderr::default(), &lines);
        assert_eq!(said.len(), WAITING + 1);
        assert_eq!(said.last().unwrap(), "7 log lines dropped: stderr did not take them");
    }

    #[test]
    fn a_flush_gives_up_where_nothing_is_written() {
        let (queue, _inbox) = Queue::new();
        queue.say(b"one\n");
        queue.flush(Duration::from_millis(1));
        for _ in 0..WAITING {
            queue.say(b"more\n");
        }
        queue.flush(Duration::from_millis(1));
    }

    #[test]
    fn a_line_without_end_is_cut() {
        let line = "x".repeat(10 * LONGEST_LINE);
        assert_eq!(written(&Stderr::default(), &[&line])[0].len(), LONGEST_LINE);
    }
}
