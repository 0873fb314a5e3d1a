//! What a camera does wrong, and what its consumers and its siblings see of it.
#![allow(clippy::unwrap_used)]

use rustix::process::Signal;
use uvcam_shm_ipc::health::{Cause, State};
use uvcam_tests::{Stage, health_where, next_frame, simulated, stderr, wait_until};

/// What a consumer saw of a camera with faults, and what the driver said.
struct Seen {
    lost: u64,
    epochs: u64,
    /// Times between the last frame of an epoch and the first of the next, seconds.
    gaps_s: Vec<f64>,
    said: String,
}

/// Takes `frames` frames of a camera with these faults. A sibling must lose nothing meanwhile.
fn with_faults(faults: &str, frames: u64) -> Seen {
    let faulty = simulated("left", "none", &format!(", faults = [{faults}]"));
    let stage = Stage::new(&(faulty + &simulated("right", "none", "")));
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    let (mut gaps_s, mut last_arrival_ns) = (Vec::new(), 0);
    wait_until("the faulty camera's frames are there", || {
        while let Some(frame) = left.receive().unwrap() {
            let arrival_ns = frame.header().arrival_monotonic_ns;
            if frame.epoch_changed() {
                gaps_s.push((arrival_ns - last_arrival_ns) as f64 * 1e-9);
            }
            last_arrival_ns = arrival_ns;
        }
        while right.receive().unwrap().is_some() {}
        left.frames() >= frames
    });
    assert_eq!((right.lost(), right.epochs()), (0, 1), "the sibling of a faulty camera");
    assert!(right.frames() > 0);
    let (lost, epochs) = (left.lost(), left.epochs());
    println!("{faults}: {lost} lost, {epochs} epochs, without frames for {gaps_s:.2?} s");
    Seen { lost, epochs, gaps_s, said: stderr(&driver.stop()) }
}

#[test]
fn lost_frames_are_counted_exactly() {
    let faults =
        "{ kind = \"lost\", at_frame = 20, count = 3 }, { kind = \"lost\", at_frame = 50, count = 1 }";
    let seen = with_faults(faults, 100);
    assert_eq!((seen.lost, seen.epochs), (4, 1));
    assert!(
        seen.said.contains("left: 1") && seen.said.contains(" 4 lost (0 of them incomplete)"),
        "{}",
        seen.said
    );
}

#[test]
fn incomplete_frames_are_not_published_and_counted() {
    let seen = with_faults("{ kind = \"incomplete\", at_frame = 20, count = 2 }", 60);
    assert_eq!((seen.lost, seen.epochs), (2, 1));
    assert!(seen.said.contains(" 2 lost (2 of them incomplete)"), "{}", seen.said);
}

#[test]
fn a_camera_that_falls_silent_is_opened_again() {
    let seen = with_faults("{ kind = \"freeze\", at_frame = 20, seconds = 1.5 }", 60);
    assert_eq!(seen.epochs, 2);
    assert!(
        seen.said.contains("left: camera left failed while streaming: no whole frame for"),
        "{}",
        seen.said
    );
}

#[test]
fn a_camera_that_stays_silent_is_listened_to_when_it_comes_back() {
    // Opened again after 1, 2.1, 3.2 s, ... and each time listened to for longer: it comes back to an open stream.
    let seen = with_faults("{ kind = \"freeze\", at_frame = 20, seconds = 6.0 }", 60);
    assert!(seen.epochs >= 2, "{} epochs", seen.epochs);
    assert_eq!(seen.gaps_s.len(), 1, "it came back once: {:?}", seen.gaps_s);
}

#[test]
fn a_camera_that_sends_nothing_whole_is_opened_again() {
    let seen = with_faults("{ kind = \"incomplete\", at_frame = 20, count = 90 }", 60);
    assert_eq!(seen.epochs, 2);
    assert!(seen.said.contains("none of them whole"), "{}", seen.said);
    // They end one epoch and begin the next.
    let told = format!(" {} lost (90 of them incomplete)", seen.lost);
    assert!(seen.lost >= 90 && seen.said.contains(&told), "{told} in {}", seen.said);
}

#[test]
fn an_unplugged_camera_is_opened_again_when_it_is_back() {
    let seen = with_faults("{ kind = \"unplug\", at_frame = 20, seconds = 3.0 }", 60);
    assert_eq!(seen.epochs, 2);
    assert!(seen.said.contains("left: camera left disconnected while"), "{}", seen.said);
    assert_eq!(
        seen.said.matches("is not connected").count(),
        1,
        "told once, not at every look: {}",
        seen.said
    );
}

#[test]
fn a_camera_that_reads_back_other_settings_publishes_nothing_until_it_takes_them() {
    let seen = with_faults("{ kind = \"wrong_settings\", at_frame = 20, count = 3 }", 60);
    assert_eq!(seen.epochs, 2);
    assert!(seen.said.contains("exposure_us = 1000 refused: the camera gives 2000"), "{}", seen.said);
}

#[test]
fn a_short_pause_of_the_camera_is_not_taken_for_a_failure() {
    let seen = with_faults("{ kind = \"freeze\", at_frame = 20, seconds = 0.4 }", 60);
    assert_eq!((seen.lost, seen.epochs), (0, 1));
}

#[test]
fn a_panic_in_a_camera_s_thread_is_told_and_the_camera_opened_again() {
    let seen = with_faults("{ kind = \"panic\", at_frame = 20 }, { kind = \"panic\", at_frame = 40 }", 60);
    assert_eq!(seen.epochs, 3);
    for expected in [
        "thread left panicked at",
        "left: the camera's thread ended by a panic: a panic by the camera's script; please report it; trying again",
    ] {
        assert!(seen.said.contains(expected), "{expected} in {}", seen.said);
    }
}

#[test]
fn a_panic_stays_in_the_health_record_and_takes_the_mask_of_the_moment_no_frame() {
    let stage =
        Stage::new(&simulated("left", "left.png", ", faults = [{ kind = \"panic\", at_frame = 30 }]"));
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let driver = stage.driver();
    let mut left = stage.subscriber("left");
    let health = health_where("the return", &mut stage.health("left"), |health| {
        health.state() == Ok(State::Streaming) && health.epochs == 2
    });
    assert!(health.last_error().contains("ended by a panic"), "{}", health.last_error());
    assert_eq!((health.failures, health.mask_id), (1, mask.id().0));
    // What is confirmed from now on happens.
    let new = stage.write_mask("left.png", (752, 480), 200);
    driver.signal(Signal::HUP);
    wait_until("the new mask flies", || next_frame(&mut left).header().mask_id == new.id().0);
    let output = driver.stop();
    assert!(output.status.success());
    let said = stderr(&output);
    assert!(said.contains(" 2 epochs") && !said.contains("files of its shared memory"), "{said}");
}

#[test]
fn a_panic_at_every_start_ends_a_driver_without_another_camera_so_that_it_can_be_started_again() {
    let panics = ["{ kind = \"panic\", at_frame = 0 }"; 20].join(", ");
    let camera = simulated("left", "none", &format!(", faults = [{panics}]"));
    let output = Stage::new(&camera).output(&["run", "--duration", "20"]);
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    assert!(!stderr(&output).contains("trying again"), "it ends: {}", stderr(&output));
    assert!(stderr(&output).contains("no camera can be used: the driver ends"), "{}", stderr(&output));
}

#[test]
fn a_camera_that_fails_over_and_over_does_not_fill_the_log() {
    let faults = |kind: &str| -> String {
        let faults = (0..30).map(|number| {
            format!(
                "{{ kind = \"{kind}\", at_frame = {}{} }}",
                10 + number * 2,
                match kind {
                    "unplug" => ", seconds = 0.05",
                    _ => "",
                }
            )
        });
        faults.collect::<Vec<_>>().join(", ")
    };
    for kind in ["unplug", "wrong_settings"] {
        let seen = with_faults(&faults(kind), 75);
        // The driver's count: a consumer may be too slow for an epoch of two frames.
        assert!(seen.said.contains(", 31 epochs"), "{kind}: {}", seen.said);
        let told = seen.said.lines().filter(|line| line.contains("left: ")).count();
        assert!(told <= 8, "{kind}: {told} lines\n{}", seen.said);
    }
}

#[test]
fn a_thread_that_is_stuck_in_a_library_is_told_of_and_its_sibling_loses_nothing() {
    let faulty = simulated("left", "none", ", faults = [{ kind = \"hang\", at_frame = 20, seconds = 13.0 }]");
    // In a process of its own it would not be waited for.
    let stage = Stage::in_one_process(&(faulty + &simulated("right", "none", "")));
    let sibling = stage.watch(&["right"]);
    let driver = stage.driver();
    let mut left = stage.health("left");
    let stuck = health_where("a stuck thread", &mut left, |health| health.cause() == Ok(Cause::Stuck));
    assert_eq!(stuck.state(), Ok(State::Reconnecting));
    health_where("its return", &mut left, |health| {
        health.state() == Ok(State::Streaming) && health.published > stuck.published
    });
    sibling.signal(Signal::INT);
    let report = sibling.json();
    assert_eq!((report["lost"].as_u64(), report["epochs"].as_u64()), (Some(0), Some(1)), "{report}");
    assert!(stderr(&driver.stop()).contains("left: nothing heard of its thread"));
}
