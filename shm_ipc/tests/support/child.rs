//! Other processes: this test binary again, in another role.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};

use super::{CAMERA, FRAME_BYTES, LOANS, PATIENCE, with};
use uvcam_shm_ipc::Settings;

const ROLE: &str = "UVCAM_TEST_ROLE";
const SETTINGS: &str = "UVCAM_TEST_SETTINGS";
/// Tells a role's lines from those of the test harness.
const MARK: &str = "child: ";

/// A process that runs the test `child` of this binary. Killed when dropped.
pub struct Role {
    child: Child,
    stdin: Option<ChildStdin>,
    lines: Receiver<String>,
}

impl Role {
    pub fn start(role: &str, settings: &Settings) -> Self {
        Role::start_in(role, settings, Path::new("."))
    }

    pub fn start_in(role: &str, settings: &Settings, folder: &Path) -> Self {
        let Settings { prefix, root_path, max_subscribers, buffer, borrowed, .. } = settings;
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child", "--ignored", "--nocapture"])
            .env(ROLE, role)
            .env(SETTINGS, format!("{prefix}|{}|{max_subscribers}|{buffer}|{borrowed}", root_path.display()))
            .current_dir(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                if let Some((_, told)) = line.split_once(MARK) {
                    let _ = sender.send(told.to_owned());
                }
            }
        });
        let stdin = child.stdin.take();
        Role { child, stdin, lines }
    }

    /// Waits until the process says `expected`.
    pub fn expect(&self, expected: &str) {
        let told = self.lines.recv_timeout(PATIENCE);
        assert_eq!(told.as_deref(), Ok(expected), "what the child said");
    }

    /// Lets the process go on to its next step.
    pub fn go_on(&mut self) {
        self.stdin.as_mut().unwrap().write_all(b"\n").unwrap();
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Ends it with SIGKILL, and waits until it is gone.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Ends its input, so that it leaves by itself, and waits until it did.
    pub fn leave(mut self) {
        self.stdin = None;
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// On the other side: what this process is to do, and with which settings.
pub fn role() -> (String, Settings) {
    let role = std::env::var(ROLE).expect("runs as a child of another test only");
    let settings = std::env::var(SETTINGS).unwrap();
    let fields: Vec<_> = settings.split('|').collect();
    let number = |index: usize| fields[index].parse().unwrap();
    let settings = with(Settings::new(fields[0], fields[1]), |it| {
        (it.max_subscribers, it.buffer, it.borrowed) = (number(2), number(3), number(4));
    });
    (role, settings)
}

/// On the other side: tells the parent.
pub fn say(text: &str) {
    println!("{MARK}{text}");
    std::io::stdout().flush().unwrap();
}

/// On the other side: waits until the parent calls [`Role::go_on`]; false where it called [`Role::leave`].
pub fn told_to_go_on() -> bool {
    std::io::stdin().read_line(&mut String::new()).unwrap() > 0
}

/// On the other side: a driver that publishes one frame at each step, as soon as anybody reads.
pub fn publish_on_demand(settings: &Settings) {
    let mut publisher = uvcam_shm_ipc::Publisher::create(settings, CAMERA, FRAME_BYTES, LOANS).unwrap();
    let epoch = publisher.begin_epoch();
    // Killed with loans out, as a driver is.
    let _loan = publisher.loan().unwrap();
    say("ready");
    for sequence in 0.. {
        if !told_to_go_on() {
            return;
        }
        super::wait_until("a consumer", || publisher.subscribers() > 0);
        super::publish(&mut publisher, epoch, sequence);
    }
}
