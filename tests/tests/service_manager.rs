//! What a service manager hears of the driver (sd_notify(3)).
#![allow(clippy::unwrap_used)]

use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use rustix::fs::{FileType, Mode};
use rustix::process::Signal;
use uvcam_shm_ipc::health::Cause;
use uvcam_tests::{Process, Stage, health_where, next_frame, simulated, stderr, wait_until};

/// The manager's end.
struct Manager {
    socket: UnixDatagram,
    /// Every line that came.
    heard: Vec<String>,
}

impl Manager {
    fn new(stage: &Stage) -> Self {
        let socket = UnixDatagram::bind(stage.file("notify")).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        Manager { socket, heard: Vec::new() }
    }

    /// Starts the driver as the service of a manager, with a watchdog of a second.
    fn start(stage: &Stage) -> (Self, Process) {
        (Manager::new(stage), Manager::driver(stage))
    }

    fn driver(stage: &Stage) -> Process {
        let mut command = stage.uvcam(&["run"]);
        command.env("NOTIFY_SOCKET", stage.file("notify"));
        Process::start(command.env("WATCHDOG_USEC", "1000000").env_remove("WATCHDOG_PID"))
    }

    /// Says so much to the manager that it can hear no more.
    fn deafen(&self, stage: &Stage) {
        let crowd = UnixDatagram::unbound().unwrap();
        crowd.set_nonblocking(true).unwrap();
        let say = || crowd.send_to(b"noise", stage.file("notify"));
        let refused = std::iter::repeat_with(say).find_map(Result::err).unwrap();
        assert_eq!(refused.kind(), ErrorKind::WouldBlock);
    }

    /// Takes what has come since.
    fn listen(&mut self) {
        let mut text = [0; 4096];
        while let Ok(length) = self.socket.recv(&mut text) {
            let text = String::from_utf8_lossy(&text[..length]).into_owned();
            self.heard.extend(text.lines().map(String::from));
        }
    }

    fn wait_for(&mut self, start: &str) {
        wait_until(start, || {
            self.listen();
            self.count(start) > 0
        });
    }

    fn count(&self, start: &str) -> usize {
        self.heard.iter().filter(|line| line.starts_with(start)).count()
    }
}

#[test]
fn ready_with_the_first_frames_then_signs_of_life_and_a_farewell() {
    // One camera that has no mask does not keep the others from being ready.
    let stage = Stage::new(&(simulated("left", "missing.png", "") + &simulated("right", "none", "")));
    let mut right = stage.subscriber("right");
    let (mut manager, driver) = Manager::start(&stage);
    manager.wait_for("READY=1");
    manager.wait_for("STATUS=left refused: mask refused");
    wait_until("ten signs of life", || {
        manager.listen();
        manager.count("WATCHDOG=1") >= 10
    });
    assert!(right.wait(Duration::from_secs(1)).unwrap(), "ready, but no frame");
    assert_eq!(manager.count("READY=1"), 1);
    driver.stop();
    manager.wait_for("STOPPING=1");
}

#[test]
fn no_sign_of_life_while_the_only_camera_s_thread_is_stuck() {
    let fault = ", faults = [{ kind = \"hang\", at_frame = 20, seconds = 60.0 }]";
    // Where it has a process of its own, that one is started again.
    let stage = Stage::in_one_process(&simulated("left", "none", fault));
    let (mut manager, _driver) = Manager::start(&stage);
    manager.wait_for("WATCHDOG=1");
    let mut health = stage.health("left");
    health_where("a stuck thread", &mut health, |health| {
        manager.listen();
        health.cause() == Ok(Cause::Stuck)
    });
    manager.wait_for("STATUS=left stuck");
    manager.heard.clear();
    // The driver itself goes on: a record each second, for three times the watchdog's time.
    for _ in 0..3 {
        health_where("a record", &mut health, |_| true);
        manager.listen();
    }
    assert_eq!(manager.count("WATCHDOG=1"), 0);
}

#[test]
fn a_camera_that_hangs_while_it_is_opened_does_not_keep_the_others_from_being_ready() {
    let hang = ", faults = [{ kind = \"hang\", at_frame = 0, seconds = 60.0 }]";
    let stage = Stage::new(&(simulated("left", "none", hang) + &simulated("right", "none", "")));
    let sibling = stage.watch(&["right"]);
    let (mut manager, driver) = Manager::start(&stage);
    manager.wait_for("READY=1");
    manager.wait_for("STATUS=left stuck; right streaming");
    still_lives(&mut manager);
    sibling.signal(Signal::INT);
    let report = sibling.json();
    assert_eq!((report["lost"].as_u64(), report["epochs"].as_u64()), (Some(0), Some(1)), "{report}");
    let output = driver.stop();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("left: its thread is stuck and left behind"), "{}", stderr(&output));
    manager.wait_for("STOPPING=1");
}

/// Waits for signs of life that come after everything heard so far.
fn still_lives(manager: &mut Manager) {
    manager.listen();
    manager.heard.clear();
    wait_until("signs of life", || {
        manager.listen();
        manager.count("WATCHDOG=1") >= 3
    });
}

#[test]
fn a_mask_file_that_never_answers_holds_up_neither_the_watchdog_nor_siblings_nor_the_end() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + &simulated("right", "right.png", "")));
    let old = stage.write_mask("left.png", (752, 480), 10);
    stage.write_mask("right.png", (752, 480), 10);
    let mut right = stage.subscriber("right");
    let (mut manager, driver) = Manager::start(&stage);
    manager.wait_for("READY=1");
    std::fs::remove_file(stage.file("left.png")).unwrap();
    rustix::fs::mknodat(rustix::fs::CWD, stage.file("left.png"), FileType::Fifo, Mode::RWXU, 0).unwrap();
    for rows in 11..40 {
        let new = stage.write_mask("right.png", (752, 480), rows);
        driver.signal(Signal::HUP);
        wait_until("the sibling's new mask", || next_frame(&mut right).header().mask_id == new.id().0);
    }
    still_lives(&mut manager);
    assert_eq!(next_frame(&mut stage.subscriber("left")).header().mask_id, old.id().0, "what was in force");
    let output = driver.stop();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn a_manager_that_does_not_listen_holds_up_nothing() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut manager = Manager::new(&stage);
    manager.deafen(&stage);
    let driver = Manager::driver(&stage);
    let mut health = stage.health("left");
    for _ in 0..3 {
        health_where("a record of a driver that goes on", &mut health, |health| health.published > 0);
    }
    manager.wait_for("READY=1");
    still_lives(&mut manager);
    assert_eq!(driver.stop().status.code(), Some(0));
}
