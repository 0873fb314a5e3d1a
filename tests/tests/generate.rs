//! Generate-mode as a field crew uses it, with and without a running driver.

#![allow(clippy::unwrap_used)]

use rustix::process::Signal;
use serde_json::Value;
use uvcam::camera::simulated::airframe;
use uvcam_emulated::gige_vision;
use uvcam_masker::{Mask, file};
use uvcam_shm_ipc::control::{ControlClient, LONGEST_TEXT, NextReply};
use uvcam_shm_ipc::health::State;
use uvcam_tests::network::in_namespace;
use uvcam_tests::{Process, Stage, health_where, next_frame, simulated, stderr, wait_until};

/// Where the simulated markers are.
const IGNORE: &str = "[camera.generate]\nignore = [\"::0:240\"]\n";

/// A simulated camera that flies `left.png`.
fn left() -> String {
    simulated("left", "left.png", "") + IGNORE
}

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stderr(output)))
}

/// Every pixel of the simulated airframe is masked, and none far from it.
fn assert_covers_airframe(mask: &Mask) {
    let shown = airframe(752, 480);
    let near = |x: u32, y: u32| {
        let reach = 36i64;
        (-reach..=reach).step_by(4).any(|dy| {
            (-reach..=reach).step_by(4).any(|dx| {
                let (x, y) = (i64::from(x) + dx, i64::from(y) + dy);
                u32::try_from(x).is_ok_and(|x| u32::try_from(y).is_ok_and(|y| y < 480 && shown(x, y)))
            })
        })
    };
    for y in 0..480 {
        for x in 0..752 {
            assert!(mask.is_masked(x, y) || !shown(x, y), "airframe at {x},{y} not masked");
            assert!(!mask.is_masked(x, y) || near(x, y), "masked at {x},{y}, far from the airframe");
        }
    }
}

#[test]
fn without_a_driver_the_camera_is_opened_and_the_candidate_stored_for_a_look() {
    let stage = Stage::new(&left());
    let output = stage.output(&["generate", "left", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report = json(&output);
    assert_eq!((report["verdict"].as_str(), report["in_force"].as_bool()), (Some("ok"), Some(false)));
    for name in ["left.candidate.png", "left.candidate.input.png", "left.candidate.overlay.png"] {
        assert!(stage.file(name).exists(), "{name}");
    }
    assert!(!stage.file("left.png").exists(), "a candidate is not in force");
    let mask = Mask::load(&stage.file("left.candidate.png")).unwrap();
    assert_eq!(report["mask_id"], mask.id().to_string());
    assert_covers_airframe(&mask);

    // One file tells all.
    let texts = file::read_texts(&stage.file("left.candidate.png")).unwrap();
    for (keyword, text) in [("Camera Serial", "left"), ("Exposure us", "5000"), ("Size", "752x480")] {
        assert!(texts.contains(&(keyword.into(), text.into())), "{texts:?}");
    }

    assert!(stage.output(&["mask", "accept", "left"]).status.success());
    assert_eq!(Mask::load(&stage.file("left.png")).unwrap(), mask);
    assert!(!stage.file("left.candidate.png").exists());
}

#[test]
fn a_running_driver_generates_between_two_epochs_and_flies_the_accepted_mask() {
    let stage = Stage::new(&(left() + &simulated("right", "none", "")));
    let old = stage.write_mask("left.png", (752, 480), 10);
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    next_frame(&mut left);

    let output = Process::start(&mut stage.uvcam(&["generate", "left", "--replace", "--json"]));
    let mut seen = Vec::new();
    wait_until("a second epoch", || {
        while right.receive().unwrap().is_some() {}
        while let Some(frame) = left.receive().unwrap() {
            seen.push((frame.header().mask_id, frame.header().exposure_us));
        }
        left.epochs() == 2
    });
    let output = output.finish();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(seen.iter().all(|seen| *seen == (old.id().0, 1000.0)), "only frames of the flight go out");
    assert_eq!((right.lost(), right.epochs()), (0, 1), "the sibling");
    assert_eq!(left.lost(), 0, "lit frames are nobody's loss");

    assert!(stage.output(&["mask", "accept", "left"]).status.success());
    let new = Mask::load(&stage.file("left.png")).unwrap();
    assert_covers_airframe(&new);
    wait_until("the new mask flies", || next_frame(&mut left).header().mask_id == new.id().0);
    assert_eq!(left.epochs(), 2, "accepted at a frame boundary");
    let said = stderr(&driver.stop());
    assert!(said.contains("left: publishes nothing while lit frames are collected"), "{said}");

    let history = stage.output(&["mask", "history", "left"]);
    assert!(String::from_utf8_lossy(&history.stdout).contains(&old.id().to_string()), "{history:?}");
    assert!(stage.output(&["mask", "restore", "left"]).status.success());
    assert_eq!(Mask::load(&stage.file("left.png")).unwrap(), old);
}

#[test]
fn a_camera_without_a_mask_gets_its_first_one_from_the_running_driver() {
    let stage = Stage::new(&(left() + &simulated("right", "none", "")));
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    next_frame(&mut right);
    let output = stage.output(&["generate", "left", "--accept", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(json(&output)["in_force"], true);
    assert_eq!(next_frame(&mut left).header().mask_id, Mask::load(&stage.file("left.png")).unwrap().id().0);
    assert!(driver.stop().status.success());
}

#[test]
fn darkness_is_refused_and_nothing_is_stored() {
    let stage = Stage::new(&left());
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let output = stage.output(&["generate", "left", "--exposure-us", "10", "--accept", "--json"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert_eq!(json(&output)["verdict"], "refused");
    assert!(stderr(&output).contains("raise the exposure"), "{}", stderr(&output));
    assert_eq!(Mask::load(&stage.file("left.png")).unwrap(), mask);
    assert!(!stage.file("left.candidate.png").exists());
}

#[test]
fn a_mask_very_different_from_the_one_in_force_is_refused_unless_it_is_to_replace_it() {
    let stage = Stage::new(&left());
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let output = stage.output(&["generate", "left", "--accept", "--json"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert_eq!(json(&output)["findings"][0]["name"], "different");
    assert!(json(&output)["overlap_with_mask_in_force"].as_f64().unwrap() < 0.5);
    assert!(stderr(&output).contains("--replace"), "{}", stderr(&output));
    assert_eq!(Mask::load(&stage.file("left.png")).unwrap(), mask);

    assert!(stage.output(&["generate", "left", "--accept", "--replace"]).status.success());
    assert_covers_airframe(&Mask::load(&stage.file("left.png")).unwrap());
    let again = stage.output(&["generate", "left", "--json"]);
    assert!(json(&again)["overlap_with_mask_in_force"].as_f64().unwrap() > 0.95, "{}", stderr(&again));
}

#[test]
fn every_camera_gets_its_mask_and_one_that_cannot_be_opened_does_not_stop_the_others() {
    let gone = "[[camera]]\nname = \"gone\"\nsource = { kind = \"replay\", path = \"nowhere\" }\n\
                width = 752\nheight = 480\nfps = 60\nexposure_us = 1000\nmask = \"gone.png\"\n";
    let stage = Stage::new(&(gone.to_owned() + &left()));
    let output = stage.output(&["generate", "--all", "--frames", "8", "--accept", "--json"]);
    assert_ne!(output.status.code(), Some(0));
    assert!(stderr(&output).contains("gone"), "{}", stderr(&output));
    let reports = json(&output);
    assert_eq!((&reports[0]["camera"], &reports[0]["verdict"]), (&"left".into(), &"ok".into()));
    assert_eq!(reports[0]["frames_used"], 8, "the cap");
    assert_covers_airframe(&Mask::load(&stage.file("left.png")).unwrap());
}

#[test]
fn what_a_command_ignores_is_ignored_besides_what_is_configured() {
    let stage = Stage::new(&left());
    assert!(stage.output(&["generate", "left", "--ignore", "376:::"]).status.success());
    let mask = Mask::load(&stage.file("left.candidate.png")).unwrap();
    assert!(mask.is_masked(200, 420) && !mask.is_masked(571, 430));
}

#[test]
fn an_exposure_that_the_camera_refuses_leaves_the_flight_as_it_was() {
    let stage = Stage::new(&left());
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let mut left = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut left);
    let output = stage.output(&["generate", "left", "--gain-db", "70"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("gain_db = 70 refused"), "{}", stderr(&output));
    wait_until("it streams again", || left.receive().unwrap().is_some() && left.epochs() == 2);
    let frame = next_frame(&mut left);
    assert_eq!((frame.header().mask_id, frame.header().exposure_us), (mask.id().0, 1000.0));
    assert!(driver.stop().status.success());
}

#[test]
fn a_request_that_a_panic_took_is_answered_and_the_next_one_done() {
    // Without a mask the camera stays closed: its first frames are the lit ones.
    let panics = simulated("left", "left.png", ", faults = [{ kind = \"panic\", at_frame = 2 }]") + IGNORE;
    let stage = Stage::new(&(panics + &simulated("right", "none", "")));
    let mut right = stage.subscriber("right");
    let _driver = stage.driver();
    next_frame(&mut right);
    let output = stage.output(&["generate", "left", "--accept"]);
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    assert!(stderr(&output).contains("the camera's thread ended by a panic"), "{}", stderr(&output));
    assert!(!stage.file("left.png").exists() && !stage.file("left.candidate.png").exists());
    let output = stage.output(&["generate", "left", "--accept", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let mask = Mask::load(&stage.file("left.png")).unwrap();
    assert_eq!(next_frame(&mut stage.subscriber("left")).header().mask_id, mask.id().0);
}

#[test]
fn a_mask_that_is_being_generated_is_waited_for_and_a_signal_ends_the_command_that_asked() {
    let stage = Stage::new(&left());
    stage.write_mask("left.png", (752, 480), 10);
    let driver = stage.driver();
    let mut health = stage.health("left");
    health_where("it streams", &mut health, |health| health.state() == Ok(State::Streaming));
    // Darkness takes all the frames that it may.
    let words = ["generate", "left", "--exposure-us", "10", "--frames", "255"];
    let first = Process::start(&mut stage.uvcam(&words));
    health_where("it generates", &mut health, |health| health.state() == Ok(State::Generating));
    let second = stage.output(&["generate", "left"]);
    assert_eq!(second.status.code(), Some(7), "{}", stderr(&second));
    assert!(
        stderr(&second).contains("mask of camera left is being generated: wait for it"),
        "{}",
        stderr(&second)
    );
    first.signal(Signal::INT);
    let first = first.finish();
    assert_eq!(first.status.code(), Some(7), "{}", stderr(&first));
    assert!(stderr(&first).contains("stopped; nothing was stored"), "{}", stderr(&first));
    health_where("it streams again", &mut health, |health| health.state() == Ok(State::Streaming));
    // The driver may still be about to see that nobody waits.
    wait_until("the next mask", || stage.output(&["generate", "left", "--replace"]).status.success());
    let said = stderr(&driver.stop());
    assert!(said.contains("left: nobody waits for the mask any more; nothing was stored"), "{said}");
    assert_eq!(said.matches("left: streaming").count(), 3, "each time it streams again: {said}");
}

/// What the driver of `left` replies to this request, and its exit code for it.
fn reply(stage: &Stage, request: &str) -> (u64, String) {
    let client = ControlClient::open(&stage.settings(), "left").unwrap().unwrap();
    let replies = client.request(request).unwrap();
    let NextReply::Text(text) = replies.receive(std::time::Duration::from_secs(20)) else {
        panic!("no reply")
    };
    let reply: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(reply["reply"], "failed", "{reply}");
    (reply["exit"].as_u64().unwrap(), reply["cause"].as_str().unwrap().into())
}

#[test]
fn requests_that_no_command_makes_are_answered_with_what_is_wrong() {
    let stage = Stage::new(&left());
    stage.write_mask("left.png", (752, 480), 10);
    let mut left = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut left);
    let request = |keys: &str| {
        format!(
            "{{\"request\":\"generate\",\"accept\":true,\"method\":\"fused\",\"ignore\":[],\"replace\":true,{keys}}}"
        )
    };
    for (text, expected) in [
        (request("\"frames\":8,\"exposure_us\":-1"), "exposure_us = -1 refused"),
        (request("\"frames\":8,\"exposure_us\":1e-300"), "exposure_us = 0.000"),
        (request("\"frames\":8,\"gain_db\":1e9"), "gain_db = 1000000000 refused"),
        (request("\"frames\":0"), "frames = 0 refused: ask for 1 to 255"),
        (request("\"frames\":4294967295"), "frames = 4294967295 refused"),
        (request("\"frames\":8,\"exposure_us\":NaN"), "does not know the request"),
        (request("\"frames\":8,\"exposure_us\":1e999"), "does not know the request"),
        ("fly".into(), "does not know the request"),
        (String::new(), "does not know the request"),
        ("[".repeat(LONGEST_TEXT), "does not know the request"),
    ] {
        let (exit, cause) = reply(&stage, &text);
        assert!(exit == 2 && cause.contains(expected), "{exit}: {cause}");
    }
    wait_until("it streams", || left.receive().unwrap().is_some());
    assert_eq!(left.epochs(), 1, "nothing was begun");
    assert!(driver.stop().status.success());
}

#[test]
fn a_request_whose_command_was_killed_stores_nothing_and_the_flight_goes_on() {
    let stage = Stage::new(&left());
    stage.write_mask("left.png", (752, 480), 10);
    let mut left = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut left);
    Process::start(&mut stage.uvcam(&["generate", "left", "--replace", "--accept"])).kill();
    let frames = left.frames();
    wait_until("it streams", || {
        while left.receive().unwrap().is_some() {}
        left.frames() >= frames + 60
    });
    assert!(driver.stop().status.success());
    Mask::load(&stage.file("left.png")).expect("a whole mask is in force");
}

#[test]
fn a_driver_killed_while_it_generates_flies_the_flight_settings_at_its_next_start() {
    let stage = Stage::new(&left());
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let mut left = stage.subscriber("left");
    for kill_after in 0..8 {
        let driver = stage.driver();
        let epochs = left.epochs();
        wait_until("it streams", || left.receive().unwrap().is_some() && left.epochs() > epochs);
        let generate = Process::start(&mut stage.uvcam(&["generate", "left", "--replace"]));
        // Some time later the driver is somewhere else in the flow each time.
        for _ in 0..kill_after {
            left.wait(std::time::Duration::from_millis(400)).unwrap();
            while left.receive().unwrap().is_some() {}
        }
        driver.kill();
        drop(generate);
        assert_eq!(Mask::load(&stage.file("left.png")).unwrap(), mask, "the mask in force");
        if stage.file("left.candidate.png").exists() {
            Mask::load(&stage.file("left.candidate.png")).expect("a candidate is whole");
        }
    }
    let _driver = stage.driver();
    let epochs = left.epochs();
    wait_until("it streams", || left.receive().unwrap().is_some() && left.epochs() > epochs);
    assert_eq!(next_frame(&mut left).header().exposure_us, 1000.0);
}

#[test]
fn a_folder_that_takes_no_files_is_named_and_the_flight_goes_on() {
    let stage = Stage::new(&(simulated("left", "/proc/left.png", "") + &simulated("right", "none", "")));
    let mut right = stage.subscriber("right");
    let driver = stage.driver();
    next_frame(&mut right);
    let output = stage.output(&["generate", "left"]);
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    assert!(stderr(&output).contains("/proc/left.candidate"), "{}", stderr(&output));
    next_frame(&mut right);
    assert_eq!(driver.stop().status.code(), Some(3), "left was never masked");
}

#[test]
fn masks_are_made_from_files() {
    let stage = Stage::new("");
    let mut frame = image::GrayImage::new(200, 150);
    for (x, y) in (80..110).flat_map(|x| (60..140).map(move |y| (x, y))) {
        frame.put_pixel(x, y, image::Luma([200]));
    }
    frame.save(stage.file("frame.png")).unwrap();
    let [from, out] = ["frame.png", "mask.png"].map(|name| stage.file(name).to_string_lossy().into_owned());
    let output =
        stage.output(&["generate", "--from", &from, &from, "--ignore", "::0:100", "--out", &out, "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(json(&output)["frames_used"], 2);
    let mask = Mask::load(&stage.file("mask.png")).unwrap();
    assert!(mask.is_masked(95, 120) && !mask.is_masked(95, 65) && !mask.is_masked(10, 120));
    assert_eq!(json(&output)["parts"][0]["area_px"], mask.masked_px());

    image::GrayImage::new(150, 200).save(stage.file("other.png")).unwrap();
    let other = stage.file("other.png").to_string_lossy().into_owned();
    let refused = stage.output(&["generate", "--from", &from, &other, "--out", &out]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("150x200"), "{}", stderr(&refused));
    assert_eq!(Mask::load(&stage.file("mask.png")).unwrap(), mask, "nothing was written");

    let output = stage.output(&["mask", "metrics", &out, &out, "--json"]);
    assert_eq!(json(&output)["over_all_parts"]["parts"], 2);
    assert_eq!(json(&output)["over_all_parts"]["area_px"]["standard_deviation"], 0.0);
}

#[test]
fn a_gige_vision_camera_generates_its_mask() {
    in_namespace("a_gige_vision_camera_generates_its_mask", || {
        let _device = gige_vision::Camera::start("GV01", 0);
        let stage = Stage::new(
            "[[camera]]\nname = \"left\"\nsource = { kind = \"aravis\", serial = \"127.0.0.1\" }\n\
             width = 640\nheight = 480\nfps = 25\nexposure_us = 10000\nmask = \"left.png\"\n\
             [camera.generate]\nexposure_us = 20000\nignore = [\"::0:240\"]\n",
        );
        let old = stage.write_mask("left.png", (640, 480), 10);
        let mut left = stage.subscriber("left");
        let driver = stage.driver();
        next_frame(&mut left);
        // The device's picture is a moving ramp, without an airframe.
        let output = stage.output(&["generate", "left", "--method", "paper", "--json"]);
        assert!(output.status.success(), "{}", stderr(&output));
        wait_until("it streams again", || left.receive().unwrap().is_some() && left.epochs() == 2);
        let frame = next_frame(&mut left);
        assert_eq!((frame.header().mask_id, frame.header().exposure_us), (old.id().0, 10_000.0));
        let texts = file::read_texts(&stage.file("left.candidate.png")).unwrap();
        assert!(texts.contains(&("Exposure us".into(), "20000".into())), "{texts:?}");
        assert!(driver.stop().status.success());
    });
}
