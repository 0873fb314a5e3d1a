//! What a service manager hears of the driver (sd_notify(3)).
#![allow(clippy::unwrap_used)]

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use uvcam_shm_ipc::health::Cause;
use uvcam_tests::{Process, Stage, health_where, simulated, wait_until};

/// The manager's end.
struct Manager {
    socket: UnixDatagram,
    /// Every line that came.
    heard: Vec<String>,
}

impl Manager {
    /// Starts the driver as its service, with a watchdog of a second.
    fn start(stage: &Stage) -> (Self, Process) {
        let path = stage.file("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        let mut command = stage.uvcam(&["run"]);
        command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "1000000").env_remove("WATCHDOG_PID");
        (Manager { socket, heard: Vec::new() }, Process::start(&mut command))
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
    let stage = Stage::new(&simulated("left", "none", fault));
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
