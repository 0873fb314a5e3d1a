//! Processes that come, go, stop and die, and what the others see of it.
#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use rustix::process::Signal;
use uvcam_tests::{Stage, next_frame, simulated, stderr, wait_until};

#[test]
fn killed_consumers_that_hold_frames_cost_nothing() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut witness = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut witness);
    for _ in 0..10 {
        // Stopped while it reads, a consumer holds what it has; then it dies.
        let consumer = stage.watch(&["left"]);
        let frames = witness.frames();
        while witness.frames() < frames + 20 {
            next_frame(&mut witness);
        }
        consumer.signal(Signal::STOP);
        next_frame(&mut witness);
        consumer.kill();
    }
    let frames = witness.frames();
    while witness.frames() < frames + 60 {
        next_frame(&mut witness);
    }
    assert_eq!((witness.lost(), witness.epochs()), (0, 1));
    let said = stderr(&driver.stop());
    assert!(said.contains(" 0 lost (0 of them incomplete), no free slot 0 times, 1 epochs"), "{said}");
}

#[test]
fn a_consumer_carries_on_after_the_driver_was_killed_and_started_again() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    let first = next_frame(&mut subscriber).header().epoch;
    driver.kill();
    while subscriber.receive().unwrap().is_some() {}

    let restarted = Instant::now();
    let _driver = stage.driver();
    let frame = next_frame(&mut subscriber);
    assert!(frame.header().epoch > first && frame.epoch_changed());
    assert_eq!(subscriber.epochs(), 2);
    println!("first frame {:?} after the driver was started again", restarted.elapsed());
}

#[test]
fn a_consumer_may_be_there_before_the_driver() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let watch = stage.watch(&["left", "--frames", "30"]);
    let _driver = stage.driver();
    let report = watch.json();
    assert_eq!((report["frames"].as_u64(), report["lost"].as_u64()), (Some(30), Some(0)));
}

#[test]
fn sigterm_and_sigint_end_the_driver_cleanly() {
    for signal in [Signal::TERM, Signal::INT] {
        let stage = Stage::new(&simulated("left", "none", ""));
        let mut subscriber = stage.subscriber("left");
        let driver = stage.driver();
        next_frame(&mut subscriber);
        driver.signal(signal);
        let output = driver.finish();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(stderr(&output).contains("frames published, 0 lost"), "{}", stderr(&output));
    }
}

#[test]
fn sighup_brings_the_new_mask_without_losing_a_frame() {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    let old = stage.write_mask("left.png", (752, 480), 10);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    assert_eq!(next_frame(&mut subscriber).header().mask_id, old.id().0);

    let new = stage.write_mask("left.png", (752, 480), 200);
    driver.signal(Signal::HUP);
    wait_until("the new mask is in force", || next_frame(&mut subscriber).header().mask_id == new.id().0);
    let frame = next_frame(&mut subscriber);
    assert!(frame.pixels()[280 * 752..].iter().all(|pixel| *pixel == 0));

    // A mask that cannot fly changes nothing.
    std::fs::write(stage.file("left.png"), b"garbage").unwrap();
    driver.signal(Signal::HUP);
    for _ in 0..30 {
        assert_eq!(next_frame(&mut subscriber).header().mask_id, new.id().0);
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 1));
    let said = stderr(&driver.stop());
    assert!(said.contains("what was in force stays"), "{said}");
}

#[test]
fn sighup_frees_a_camera_that_was_refused_for_its_mask() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + &simulated("right", "none", "")));
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    next_frame(&mut right);
    let mask = stage.write_mask("left.png", (752, 480), 10);
    driver.signal(Signal::HUP);
    assert_eq!(next_frame(&mut left).header().mask_id, mask.id().0);
    assert!(driver.stop().status.success());
}

#[test]
fn a_second_driver_is_refused_and_the_first_goes_on() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);
    let second = stage.output(&["run", "--duration", "20"]);
    assert_eq!(second.status.code(), Some(5), "{}", stderr(&second));
    assert!(stderr(&second).contains("another"), "{}", stderr(&second));
    for _ in 0..10 {
        next_frame(&mut subscriber);
    }
    assert_eq!(subscriber.epochs(), 1);
    assert!(stderr(&driver.stop()).contains(" 0 lost"));
}

#[test]
fn a_stopped_consumer_is_told_what_it_lost_and_delays_nobody() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let mut witness = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut witness);
    let slow = stage.watch(&["left"]);
    let frames = witness.frames();
    while witness.frames() < frames + 30 {
        next_frame(&mut witness);
    }
    slow.signal(Signal::STOP);
    // Far more than it can lag behind.
    let frames = witness.frames();
    while witness.frames() < frames + 90 {
        next_frame(&mut witness);
    }
    slow.signal(Signal::CONT);
    next_frame(&mut witness);
    slow.signal(Signal::INT);
    let report = slow.json();
    assert!(report["lost"].as_u64().unwrap() > 0, "{report}");
    assert_eq!(witness.lost(), 0);
    assert!(stderr(&driver.stop()).contains(" 0 lost"));
}

#[test]
fn a_camera_that_is_absent_ends_the_driver_with_the_code_of_a_camera() {
    let stage = Stage::new(
        "[[camera]]\nname = \"left\"\nsource = { kind = \"replay\", path = \"nowhere\" }\n\
         width = 8\nheight = 8\nfps = 10\nexposure_us = 1000\nmask = \"none\"\n",
    );
    let start = Instant::now();
    let output = stage.output(&["run", "--duration", "60"]);
    assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
    assert!(stderr(&output).contains("nowhere"), "{}", stderr(&output));
    assert!(start.elapsed() < Duration::from_secs(60), "it waited for the end of its time");
}
