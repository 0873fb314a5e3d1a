//! The real driver on a GigE Vision camera that dies, comes back and loses packets.

use std::time::{Duration, Instant};

use uvcam_emulated::gige_vision::{self, ADDRESS};
use uvcam_shm_ipc::Subscriber;
use uvcam_shm_ipc::health::{Cause, State};
use uvcam_tests::network::in_namespace;
use uvcam_tests::{Stage, health_where, next_frame, simulated, stderr};

use crate::is_ramp;

/// A configuration's table of the emulated camera, as it is without a lamp and without gain.
fn gige(serial: &str) -> String {
    format!(
        "[[camera]]\nname = \"left\"\nsource = {{ kind = \"aravis\", serial = \"{serial}\" }}\n\
         width = 640\nheight = 480\nfps = 25\nexposure_us = 10000\nmask = \"none\"\n"
    )
}

/// Reads whole frames until one of another epoch comes, and returns how long after `since` that was.
fn recovery(subscriber: &mut Subscriber, since: Instant) -> Duration {
    loop {
        let frame = next_frame(subscriber);
        assert!(is_ramp(frame.pixels(), 640));
        if frame.epoch_changed() {
            return since.elapsed();
        }
    }
}

/// Kills and restarts the camera `serial` after each of these pauses; `wanted` is what the configuration names.
fn dies_and_comes_back(serial: &str, wanted: &str, pauses_s: &[f64]) {
    let mut program = gige_vision::Camera::start(serial, 0);
    let stage = Stage::new(&(gige(wanted) + &simulated("right", "none", "")));
    let sibling = stage.watch(&["right"]);
    let mut left = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut left);
    let mut health = stage.health("left");
    for (times, pause_s) in pauses_s.iter().enumerate() {
        drop(program);
        let failed =
            health_where("the failure", &mut health, |health| health.state() == Ok(State::Reconnecting));
        let told = [Cause::Silent, Cause::Disconnected, Cause::Absent, Cause::Device];
        assert!(told.contains(&failed.cause().unwrap()), "{failed:?}");
        // Time passes here because it is what is tested.
        std::thread::sleep(Duration::from_secs_f64(*pause_s));
        program = gige_vision::Camera::start(serial, 0);
        let took = recovery(&mut left, Instant::now());
        println!(
            "{wanted}: first whole frame {took:.2?} after the camera's return, gone {pause_s} s after it was missed"
        );
        assert_eq!(left.epochs(), times as u64 + 2);
    }
    sibling.signal(rustix::process::Signal::INT);
    let report = sibling.json();
    assert_eq!((report["lost"].as_u64(), report["epochs"].as_u64()), (Some(0), Some(1)), "{report}");
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn a_camera_that_dies_is_found_again_by_its_serial() {
    in_namespace("supervision::a_camera_that_dies_is_found_again_by_its_serial", || {
        dies_and_comes_back("GV7", "GV7", &[0.0, 3.0]);
    });
}

#[test]
fn a_camera_that_dies_is_found_again_at_its_address() {
    in_namespace("supervision::a_camera_that_dies_is_found_again_at_its_address", || {
        dies_and_comes_back("GV7", ADDRESS, &[0.0, 3.0]);
    });
}

#[test]
fn another_camera_at_the_address_is_not_flown_and_itself_is() {
    in_namespace("supervision::another_camera_at_the_address_is_not_flown_and_itself_is", || {
        let program = gige_vision::Camera::start("GV7", 0);
        let stage = Stage::new(&gige(ADDRESS));
        let mut left = stage.subscriber("left");
        let driver = stage.driver();
        next_frame(&mut left);
        let mut health = stage.health("left");
        drop(program);
        let program = gige_vision::Camera::start("GV8", 0);
        let refused = health_where("the refusal", &mut health, |health| {
            health.state() == Ok(State::Reconnecting) && health.last_error().contains("GV8")
        });
        assert_eq!(refused.cause(), Ok(Cause::Absent));
        let told = refused.last_error();
        assert!(told.contains("Fake \"GV7\" was opened first") && told.contains("Fake \"GV8\""), "{told}");
        // Nothing of the other one goes out, however often it is looked at.
        let tries = refused.failures + 2;
        health_where("further looks", &mut health, |health| health.failures >= tries);
        while left.receive().unwrap().is_some() {}
        assert_eq!(left.epochs(), 1, "a frame of the other camera");
        drop(program);
        let _program = gige_vision::Camera::start("GV7", 0);
        recovery(&mut left, Instant::now());
        assert_eq!(left.epochs(), 2);
        let output = driver.stop();
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stderr(&output).contains("left: streaming, Fake \"GV7\", "), "{}", stderr(&output));
    });
}

#[test]
fn an_absent_camera_beside_another_one_is_told_once() {
    in_namespace("supervision::an_absent_camera_beside_another_one_is_told_once", || {
        let _program = gige_vision::Camera::start("OTHER", 0);
        let stage = Stage::new(&(gige("GV7") + &simulated("right", "none", "")));
        let mut right = stage.subscriber("right");
        let driver = stage.driver();
        // Three searches of the network, each two seconds after the one before and one second long.
        while right.frames() < 8 * 60 {
            next_frame(&mut right);
        }
        let output = driver.stop();
        let lines = stderr(&output);
        let warnings: Vec<_> = lines.lines().filter(|line| line.contains("GV7")).collect();
        assert_eq!(warnings.len(), 1, "{lines}");
        assert!(warnings[0].contains("found: Aravis Fake \"OTHER\" (GigEVision 127.0.0.1)"), "{lines}");
    });
}

#[test]
fn where_no_frame_is_ever_whole_firewall_and_packet_size_are_named() {
    let name = "supervision::where_no_frame_is_ever_whole_firewall_and_packet_size_are_named";
    in_namespace(name, || {
        // Nothing comes at all, and of every frame of about 220 packets a part.
        for (lost_per_thousand, expected) in [(1000, "no whole frame for"), (100, "none of them whole")] {
            let _program = gige_vision::Camera::start("GV7", lost_per_thousand);
            let output = Stage::new(&gige(ADDRESS)).driver().finish();
            let text = stderr(&output);
            assert_eq!(output.status.code(), Some(4), "{text}");
            let told =
                [expected, "UDP from 127.0.0.1", "nft list ruleset", "GevSCPSPacketSize", "in packets of"];
            for word in told {
                assert!(text.contains(word), "{word}: {text}");
            }
        }
    });
}

#[test]
fn with_two_lost_packets_in_ten_thousand_every_frame_is_whole_and_every_loss_counted() {
    let name =
        "supervision::with_two_lost_packets_in_ten_thousand_every_frame_is_whole_and_every_loss_counted";
    in_namespace(name, || {
        let _program = gige_vision::Camera::start("GVLOSS", 0.2);
        let stage = Stage::new(&gige("GVLOSS"));
        let mut left = stage.subscriber("left");
        let driver = stage.driver();
        let mut last_picture = None;
        // About 220 packets a frame: one frame in 23 is lost.
        while left.frames() < 500 || left.lost() == 0 {
            let frame = next_frame(&mut left);
            assert!(is_ramp(frame.pixels(), 640), "frame {}", frame.header().device_frame_id);
            // The camera draws its own count of frames: the ramp begins with it, modulo 255.
            let picture = u64::from(frame.pixels()[0]);
            if let Some(last) = last_picture {
                let step = (255 + picture - last) % 255;
                assert_eq!(step, (1 + frame.lost_before()) % 255, "after frame {last} came {picture}");
            }
            last_picture = Some(picture);
        }
        let (lost, frames) = (left.lost(), left.frames());
        println!("0.2 of 1000 packets lost: {frames} whole frames, {lost} lost and counted");
        assert_eq!(left.epochs(), 1);
        let health = health_where("the count", &mut stage.health("left"), |health| health.lost >= lost);
        assert!(health.incomplete > 0, "{health:?}");
        driver.stop();
    });
}
