//! A log that cannot be written, or that nobody reads: no camera stops for it, and no command dies of it.
#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::io::{ErrorKind, PipeReader, Read, Write, pipe};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rustix::io::ioctl_fionbio;
use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use uvcam_shm_ipc::health::State;
use uvcam_tests::{Stage, binary, health_where, next_frame, simulated, status_field, stderr, wait_until};

const SIZE: (u32, u32) = (64, 48);

/// A camera that gives the driver something to say three times, and a sibling. Small ones that stand still, and a second of frames in
/// hand, so that what is lost tells of the log and not of a busy machine.
fn cameras() -> Stage {
    let unplug = |at_frame| format!("{{ kind = \"unplug\", at_frame = {at_frame}, seconds = 0.1 }}");
    let faults = format!(", faults = [{}, {}, {}]", unplug(20), unplug(40), unplug(60));
    let camera = |name: &str, mask: &str, faults: &str| {
        let large = simulated(name, mask, &format!(", still = true{faults}"));
        large.replace("width = 752\nheight = 480", &format!("width = {}\nheight = {}", SIZE.0, SIZE.1))
    };
    let cameras = camera("left", "left.png", &faults) + &camera("right", "none", "");
    let stage = Stage::new(&("buffer = 64\nslots = 64\n".to_owned() + &cameras));
    stage.write_mask("left.png", SIZE, 1);
    stage
}

/// A driver whose stderr is `to`. It is killed where the test ends first.
struct Driver(Child);

impl Driver {
    fn start(stage: &Stage, to: impl Into<Stdio>) -> Self {
        Driver(stage.uvcam(&["run"]).stdout(Stdio::null()).stderr(to).spawn().unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }

    /// Asks it to stop, and waits for the code that it ends with.
    fn stop(mut self) -> Option<i32> {
        self.signal(Signal::TERM);
        let mut status = None;
        wait_until("its end", || {
            status = self.0.try_wait().unwrap();
            status.is_some()
        });
        status.and_then(|status| status.code())
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The faulty camera comes back each time, a new mask flies, and the sibling loses nothing.
fn assert_flies(stage: &Stage, read_masks: impl FnOnce()) {
    let sibling = stage.watch(&["right"]);
    health_where("four epochs of the faulty camera", &mut stage.health("left"), |health| {
        health.epochs == 4 && health.state() == Ok(State::Streaming)
    });
    let mask = stage.write_mask("left.png", SIZE, 20);
    read_masks();
    let mut left = stage.subscriber("left");
    wait_until("the new mask flies", || next_frame(&mut left).header().mask_id == mask.id().0);
    let right = stage.health("right").wait(Duration::from_secs(20)).unwrap().unwrap();
    assert_eq!((right.lost, right.epochs), (0, 1), "the sibling");
    sibling.signal(Signal::INT);
    let report = sibling.json();
    assert_eq!((report["lost"].as_u64(), report["epochs"].as_u64()), (Some(0), Some(1)), "{report}");
}

fn flies_with_stderr(to: impl Into<Stdio>) {
    let stage = cameras();
    let driver = Driver::start(&stage, to);
    assert_flies(&stage, || driver.signal(Signal::HUP));
    assert_eq!(driver.stop(), Some(0));
}

#[test]
fn a_pipe_whose_reader_is_gone_ends_no_driver() {
    let (_, writer) = pipe().unwrap();
    flies_with_stderr(writer);
}

#[test]
fn a_full_disk_ends_no_driver() {
    flies_with_stderr(File::options().write(true).open("/dev/full").unwrap());
}

/// A pipe that holds as much as it can.
fn full_pipe() -> (PipeReader, Stdio) {
    let (reader, mut writer) = pipe().unwrap();
    ioctl_fionbio(&writer, true).unwrap();
    let refused = std::iter::repeat_with(|| writer.write(b"\n")).find_map(Result::err).unwrap();
    assert_eq!(refused.kind(), ErrorKind::WouldBlock);
    ioctl_fionbio(&writer, false).unwrap();
    (reader, writer.into())
}

#[test]
fn a_pipe_that_nobody_reads_holds_nobody_up_and_has_every_line_later() {
    let (mut reader, full) = full_pipe();
    let stage = cameras();
    let driver = Driver::start(&stage, full);
    assert_flies(&stage, || driver.signal(Signal::HUP));
    let text = std::thread::spawn(move || {
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        text
    });
    assert_eq!(driver.stop(), Some(0));
    let said = text.join().unwrap();
    assert!(said.contains("left: streaming") && said.contains("right: streaming"), "{said}");
    assert!(said.contains("left: mask") && said.contains("from the next frame on"), "{said}");
}

#[test]
fn a_driver_whose_log_nobody_reads_ends_when_it_is_asked_to() {
    let (_reader, full) = full_pipe();
    let stage = cameras();
    let mut right = stage.subscriber("right");
    let driver = Driver::start(&stage, full);
    next_frame(&mut right);
    assert_eq!(driver.stop(), Some(0));
}

/// A driver that is no child of this process. It is killed where the test ends first.
struct Foreign(Pid);

impl Drop for Foreign {
    fn drop(&mut self) {
        // Where it has ended by itself there is nothing left to end.
        let _ = kill_process(self.0, Signal::KILL);
    }
}

#[test]
fn a_terminal_that_goes_away_ends_no_driver() {
    let stage = cameras();
    // script(1) of bsdutils runs the driver in a terminal of its own; exec leaves no shell in between.
    let line = format!("exec {} run --config {}", binary().display(), stage.file("uvcam.toml").display());
    let terminal = Command::new("script")
        .args(["--quiet", "--command", &line, "/dev/null"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn();
    let mut terminal = Driver(terminal.expect("script: install the package bsdutils"));
    let camera = stage.process_of("right").as_raw_nonzero().get() as u32;
    let id = status_field(camera, "PPid:").unwrap();
    let driver = Foreign(Pid::from_raw(id.parse().unwrap()).unwrap());
    terminal.0.kill().unwrap();
    terminal.0.wait().unwrap();
    // Told by the kernel that its terminal is gone, it reads the masks anew, as it is told now.
    assert_flies(&stage, || kill_process(driver.0, Signal::HUP).unwrap());
    kill_process(driver.0, Signal::TERM).unwrap();
    wait_until("its end", || test_kill_process(driver.0).is_err());
}

#[test]
fn commands_whose_readers_are_gone_end_as_if_they_were_there() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    for words in [&["config"][..], &["stats"], &["watch", "left", "--frames", "3"], &["mask", "--help"]] {
        let gone = || Stdio::from(pipe().unwrap().1);
        let status = stage.uvcam(words).stdout(gone()).stderr(gone()).status().unwrap();
        assert_eq!(status.code(), Some(0), "{words:?}");
    }
    let full = || Stdio::from(File::options().write(true).open("/dev/full").unwrap());
    let output = stage.uvcam(&["config"]).stdout(full()).stderr(Stdio::piped()).spawn().unwrap();
    let output = output.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(7));
    assert!(stderr(&output).contains("writing to stdout: No space left on device"), "{}", stderr(&output));
    // Whatever they were told, they say it in vain.
    let status = stage.uvcam(&["stats", "nobody"]).stdout(full()).stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(5));
    drop(driver);
}

#[test]
fn what_iceoryx2_says_takes_the_same_way() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let words = ["run", "--duration", "1"];
    let talkative = |command: &mut Command| command.env("IOX2_LOG_LEVEL", "trace").output().unwrap();
    let said = stderr(&talkative(&mut stage.uvcam(&words)));
    assert!(said.contains("WARN iceoryx2: ") && !said.contains("[T]"), "{said}");
}

#[test]
fn a_thread_that_the_system_does_not_give_is_no_fault_of_the_configuration() {
    let stage = Stage::new(&simulated("left", "none", ""));
    // No address space holds a stack of this size: pthread_create(3) says EAGAIN, as where `ulimit -u` is reached.
    let huge = (1u64 << 50).to_string();
    let output = stage.uvcam(&["run", "--duration", "20"]).env("RUST_MIN_STACK", huge).output().unwrap();
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    assert!(stderr(&output).contains("starting thread signals: Resource temporarily"), "{}", stderr(&output));
}
