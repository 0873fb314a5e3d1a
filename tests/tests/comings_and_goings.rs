//! Consumers that come and go, of the right user and of the wrong one, stopped and killed: nobody else loses a frame.
#![allow(clippy::unwrap_used)]

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use rustix::process::Signal;
use serde_json::Value;
use uvcam_shm_ipc::{FrameHeader, Settings, frame_service_name};
use uvcam_tests::{Process, Stage, simulated, stderr, users};

/// How often somebody comes.
const COMINGS: usize = 100;
/// Where the intruder finds the service: prefix and folder.
const PLACE: &str = "UVCAM_TEST_PLACE";

/// A process of another user that does not look whom the service belongs to. Reads nothing, holds its place until it is killed.
#[test]
#[ignore = "runs as a child of another test"]
fn intruder() {
    let place = std::env::var(PLACE).unwrap();
    let (prefix, root_path) = place.split_once('|').unwrap();
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes()).unwrap();
    config.global.set_root_path(&Path::new(root_path.as_bytes()).unwrap());
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    set_log_level(LogLevel::Fatal);
    let node = NodeBuilder::new().config(&config).create::<ipc_threadsafe::Service>().unwrap();
    // Nobody but its own user can clean up after an intruder that was killed.
    node.try_cleanup_dead_nodes();
    let frames = node
        .service_builder(&ServiceName::new(&frame_service_name("left")).unwrap())
        .publish_subscribe::<[u8]>()
        .user_header::<FrameHeader>()
        .open()
        .unwrap();
    let _subscriber = frames.subscriber_builder().create().unwrap();
    println!("signed in");
    std::io::stdin().lines().for_each(drop);
}

/// Numbers without a pattern that matters here: the upper bits of a linear congruential generator (Knuth's MMIX constants).
fn random_numbers(mut state: u64) -> impl FnMut() -> u64 {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    }
}

/// Starts the intruder, lets it come and go with its user's rights.
fn intrude(settings: &Settings, is_killed: bool) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "intruder", "--ignored", "--nocapture"])
        .env(PLACE, format!("{}|{}", settings.prefix, settings.root_path.display()))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("signed in")), "the intruder has no place");
    std::thread::sleep(Duration::from_millis(250));
    if is_killed {
        child.kill().unwrap();
        child.wait().unwrap();
    } else {
        drop(child.stdin.take());
        assert!(child.wait().unwrap().success());
    }
}

#[test]
fn a_hundred_consumers_of_every_kind_cost_nobody_a_frame() {
    let stage = Stage::new(&simulated("left", "none", ""));
    users::give_to_other(stage.folder());
    let start = |words: &[&str]| Process::start(&mut users::other(&stage.uvcam(words)));
    let driver = start(&["run"]);
    let witness = start(&["watch", "left", "--json", "--timeout", "20"]);
    let other_witness = start(&["watch", "left", "--json", "--timeout", "20"]);
    let stats = || -> Value {
        let output = users::other(&stage.uvcam(&["stats", "left", "--json"])).output().unwrap();
        serde_json::from_slice(&output.stdout).unwrap_or_default()
    };
    uvcam_tests::wait_until("frames", || stats()[0]["published"].as_u64() > Some(60));

    let mut moment = random_numbers(7);
    for coming in 0..COMINGS {
        match coming % 5 {
            // Of the right user: comes, reads, leaves.
            0 => _ = start(&["watch", "left", "--frames", "5", "--timeout", "20"]).finish(),
            // Killed at any moment, most of them on their way in.
            1 | 2 => {
                let consumer = start(&["watch", "left"]);
                std::thread::sleep(Duration::from_millis(moment() % 60));
                consumer.kill();
            }
            // Stopped with a full buffer, then killed.
            3 => {
                let consumer = start(&["watch", "left"]);
                std::thread::sleep(Duration::from_millis(50 + moment() % 100));
                consumer.signal(Signal::STOP);
                std::thread::sleep(Duration::from_millis(100));
                consumer.kill();
            }
            _ => intrude(&stage.settings(), coming % 2 == 0),
        }
    }
    let health = stats();
    for witness in [witness, other_witness] {
        witness.signal(Signal::INT);
        let report = witness.json();
        println!("{} frames, {} lost", report["frames"], report["lost"]);
        assert_eq!(report["lost"].as_u64(), Some(0), "{report}");
        assert_eq!(report["epochs"].as_u64(), Some(1), "{report}");
    }
    println!("{COMINGS} comings and goings: masked to sent {}", health[0]["masked_to_sent_us"]);
    let said = stderr(&driver.stop());
    assert!(said.contains(" 0 lost (0 of them incomplete), no free slot 0 times, 1 epochs"), "{said}");
}
