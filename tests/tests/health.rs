//! What a driver tells of its cameras, through the health service and `uvcam stats`.
#![allow(clippy::unwrap_used)]

use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;
use uvcam_shm_ipc::health::{Cause, State};
use uvcam_tests::{Stage, children, health_where, next_frame, simulated, stderr};

fn stats(stage: &Stage, words: &[&str]) -> Value {
    let output = stage.output(&[&["stats", "--json"], words].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_record_agrees_with_what_a_consumer_counts() {
    let faults =
        "{ kind = \"lost\", at_frame = 20, count = 3 }, { kind = \"incomplete\", at_frame = 40, count = 2 }";
    let stage = Stage::new(&simulated("left", "left.png", &format!(", faults = [{faults}]")));
    let mask = stage.write_mask("left.png", (752, 480), 10);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    while subscriber.frames() < 60 {
        next_frame(&mut subscriber);
    }
    let health = health_where("60 frames", &mut stage.health("left"), |health| health.published >= 60);
    assert_eq!((health.state(), health.cause()), (Ok(State::Streaming), Ok(Cause::None)));
    assert_eq!((health.lost, subscriber.lost()), (5, 5));
    assert_eq!((health.incomplete, health.no_free_slot, health.epochs, health.failures), (2, 0, 1, 0));
    assert_eq!(health.mask_id, mask.id().0);
    assert_eq!(
        children(driver.id()),
        [health.process_id],
        "the process of the camera, which the driver has started"
    );
    assert_eq!(health.temperature_c(), Some(40.0));
    assert!(health.resident_bytes > 0 && health.cpu_ns > 0 && health.frame_rate > 0.0);
    for latency in [health.arrival_to_masked, health.masked_to_sent] {
        assert!(latency.count >= 60 && latency.p50_ns > 0, "{latency:?}");
    }
}

#[test]
fn the_digest_is_that_of_the_configuration_s_text() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let _driver = stage.driver();
    let digest = stats(&stage, &["left"])[0]["config_digest"].as_str().unwrap().to_owned();
    let sum = Command::new("sha256sum").arg(stage.file("uvcam.toml")).output().unwrap().stdout;
    assert_eq!(digest.as_bytes(), &sum[..32]);
}

#[test]
fn a_failure_is_told_while_it_lasts_and_remembered_after() {
    let fault = ", faults = [{ kind = \"unplug\", at_frame = 20, seconds = 1.0 }]";
    let stage = Stage::new(&simulated("left", "none", fault));
    let _driver = stage.driver();
    let mut reader = stage.health("left");
    let failed = health_where("the failure", &mut reader, |health| health.state() == Ok(State::Reconnecting));
    assert!([Ok(Cause::Disconnected), Ok(Cause::Absent)].contains(&failed.cause()), "{failed:?}");
    assert!(failed.last_error().contains("left"), "{}", failed.last_error());
    let again = health_where("the return", &mut reader, |health| health.state() == Ok(State::Streaming));
    assert!(again.failures == 1 && again.epochs == 2, "{again:?}");
    assert!(!again.last_error().is_empty());
    assert!(again.state_since_monotonic_ns > failed.state_since_monotonic_ns);
}

#[test]
fn a_refused_camera_and_the_mask_that_frees_it_are_told() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + &simulated("right", "none", "")));
    let driver = stage.driver();
    let mut reader = stage.health("left");
    let refused = health_where("the refusal", &mut reader, |health| health.state() == Ok(State::Refused));
    assert_eq!(refused.cause(), Ok(Cause::Mask));
    assert!(refused.last_error().contains("left.png"), "{}", refused.last_error());
    let mask = stage.write_mask("left.png", (752, 480), 10);
    driver.signal(Signal::HUP);
    health_where("the mask", &mut reader, |health| {
        health.mask_id == mask.id().0 && health.state() == Ok(State::Streaming)
    });
}

#[test]
fn stats_asks_one_camera_or_all_and_says_where_no_driver_runs() {
    let stage = Stage::new(&(simulated("left", "none", "") + &simulated("right", "none", "")));
    let driver = stage.driver();
    for camera in ["left", "right"] {
        health_where("frames", &mut stage.health(camera), |health| health.published > 0);
    }
    let names = |report: &Value| -> Vec<String> {
        report.as_array().unwrap().iter().map(|camera| camera["camera"].as_str().unwrap().into()).collect()
    };
    assert_eq!(names(&stats(&stage, &[])), ["left", "right"]);
    assert_eq!(names(&stats(&stage, &["right"])), ["right"]);
    let table = String::from_utf8(stage.output(&["stats"]).stdout).unwrap();
    for word in ["left", "right", "p99.9", "arrival to masked", "masked to sent", "40.0 \u{b0}C"] {
        assert!(table.contains(word), "{word} in\n{table}");
    }
    driver.stop();
    let output = stage.output(&["stats", "left"]);
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(stderr(&output).contains("uvcam run"), "{}", stderr(&output));
}
