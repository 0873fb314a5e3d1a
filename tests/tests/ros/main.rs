//! The package `shm_ipc/ros` under a real ROS master and a real nodelet manager, beside a running driver.
//!
//! `UVCAM_ROS_S=60` lets the frames of the first test flow for a minute instead of some seconds.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::net::TcpStream;

use rustix::process::Signal;
use serde_json::Value;
use uvcam_shm_ipc::Subscriber;
use uvcam_tests::{Process, Stage, next_frame, simulated, stderr, wait_until};

mod network;

use network::{Launched, Ros, Seen, configure, package, prefix, unload};

const SIZE: (u32, u32) = (752, 480);
const MASKED_ROWS: u32 = 40;
/// Room for a machine that does something else for a second.
const ROOM: &str = "max_subscribers = 4\nbuffer = 64\n";

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A stage whose camera "left" flies a mask of the lower rows.
fn masked(source: &str) -> Stage {
    let stage = Stage::new(&(ROOM.to_owned() + &simulated("left", "left.png", source)));
    stage.write_mask("left.png", SIZE, MASKED_ROWS);
    stage
}

/// Stamps of frames, as their headers say.
fn stamps(subscriber: &mut Subscriber, count: usize) -> Vec<u64> {
    (0..count).map(|_| next_frame(subscriber).header().mid_exposure_realtime_ns).collect()
}

/// Asserts that `theirs` are `ours`, from the first to the last that both have, and none besides, in order.
fn assert_all_of(ours: &[u64], theirs: &[u64], who: &str) {
    let begin = ours[0].max(theirs[0]);
    let within = |stamps: &[u64]| -> Vec<u64> {
        let end = *ours.last().unwrap();
        stamps.iter().copied().filter(|stamp| (begin..=end).contains(stamp)).collect()
    };
    let (ours, theirs) = (within(ours), within(theirs));
    assert!(ours.is_sorted_by(|one, next| one < next), "headers: {ours:?}");
    assert_eq!(theirs, ours, "{who}");
    assert!(ours.len() > 100, "{who}: {} in common", ours.len());
}

#[test]
fn every_frame_reaches_subscribers_in_the_manager_and_outside() {
    let seconds: usize = std::env::var("UVCAM_ROS_S").map_or(5, |seconds| seconds.parse().unwrap());
    let stage = masked("");
    let calibration = "image_width: 752\nimage_height: 480\ncamera_name: left\n\
                       camera_matrix: {rows: 3, cols: 3, data: [300, 0, 376, 0, 301, 240, 0, 0, 1]}\n\
                       distortion_model: plumb_bob\n\
                       distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n\
                       rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n\
                       projection_matrix: {rows: 3, cols: 4, data: [300, 0, 376, 0, 0, 301, 240, 0, 0, 0, 1, 0]}\n";
    std::fs::write(stage.file("left.yaml"), calibration).unwrap();
    let ros = Ros::new(&stage);
    let _master = ros.master();
    let driver = stage.driver();
    let _manager = ros.manager();
    let (_probe, probe) = ros.probe();
    let url = format!("_calib_url:=file://{}", stage.file("left.yaml").display());
    let _camera = ros.camera(&[&url, "_frame_id:=uvcam_left", "_queue_size:=10000"]);
    let (_listener, listener) = ros.listener("listener");
    wait_until("an image outside", || !listener.heard("image").is_empty());
    probe.more(1);
    // With a mask that has a name from here on.
    wait_until("the mask", || !listener.heard("mask").is_empty());

    let mut subscriber = stage.subscriber("left");
    let mask_id = hex(&next_frame(&mut subscriber).header().mask_id);
    let ours = stamps(&mut subscriber, seconds * 60);
    assert_eq!(subscriber.lost(), 0, "the test itself was too slow");
    let is_last = |stamps: Vec<u64>| stamps.last().is_some_and(|last| last >= ours.last().unwrap());
    wait_until("the last image inside", || is_last(probe.stamps()));
    wait_until("the last image outside", || {
        is_last(listener.stamps("info")) && is_last(listener.stamps("image"))
    });
    drop(driver);

    assert_all_of(&ours, &probe.stamps(), "inside");
    assert_all_of(&ours, &listener.stamps("image"), "outside");
    assert_all_of(&ours, &listener.stamps("info"), "camera_info");
    // In one process, nobody makes a copy; the bridge's own memory is used again and again.
    let connections = listener.heard("connections");
    assert_eq!(connections[0]["transports"], serde_json::json!(["INTRAPROCESS", "TCPROS"]));
    let addresses: BTreeSet<String> = probe.seen().into_iter().map(|seen| seen.address).collect();
    assert!(addresses.len() <= 8, "{addresses:?}");

    for image in listener.heard("image") {
        assert_eq!(image["shape"], serde_json::json!(["mono8", 752, 480, 752, 0]));
        let (bytes, first) = (image["bytes"].as_u64(), image["first_black_row"].as_u64());
        assert_eq!((bytes, first), (Some(752 * 480), Some((SIZE.1 - MASKED_ROWS).into())));
        assert_eq!(image["frame_id"], "uvcam_left");
    }
    let mask = &listener.heard("mask")[0];
    assert_eq!(mask["shape"], serde_json::json!(["mono8", 752, 480, 752, 0]));
    assert_eq!(mask["first_black_row"], SIZE.1 - MASKED_ROWS);
    assert_eq!(listener.heard("info")[0]["k"][4], 301.0);

    let frames = listener.report("frames", |report| report["level"] == 0);
    assert_eq!(frames["values"]["mask"], mask_id.as_str(), "{frames}");
    let reports = listener.heard("diagnostics");
    let lost: Vec<&Value> =
        reports.iter().filter_map(|report| report["values"].get("black in place of lost")).collect();
    assert!(lost.iter().all(|black| **black == "0"), "{lost:?}");
    let driver = listener.report("driver", |report| report["level"] == 0);
    assert_eq!(driver["values"]["state"], "streaming", "{driver}");
    assert_eq!(driver["values"]["mask"], mask_id.as_str(), "{driver}");
    let rate = listener.report("rate", |report| report["values"]["Events since startup"] != "0");
    let target: f64 = rate["values"]["Target frequency (Hz)"].as_str().unwrap().parse().unwrap();
    assert!((target - 60.0).abs() < 0.001, "{rate}");
    assert_eq!(rate["name"], "uav1/uvdar_bluefox/left: rate");
}

#[test]
fn publication_resumes_when_nodelet_driver_and_master_come_back() {
    let stage = masked("");
    let ros = Ros::new(&stage);
    let master = ros.master();
    let _manager = ros.manager();
    let (_probe, probe) = ros.probe();
    let camera = ros.camera(&[]);
    // Before there is a driver.
    let (_early, early) = ros.listener("early");
    early.report("driver", |report| report["level"] == 2 && report["message"] == "no driver runs");
    let driver = stage.driver();
    probe.more(30);

    unload(camera);
    let _camera = ros.camera(&[]);
    probe.more(30);

    driver.kill();
    let mut subscriber = stage.subscriber("left");
    let _driver = stage.driver();
    let first = stamps(&mut subscriber, 1)[0];
    wait_until("frames of the next driver", || probe.stamps().last().is_some_and(|last| *last > first));

    master.kill();
    probe.more(30);
    let _master = ros.master();
    let (_late, late) = ros.listener("late");
    wait_until("images for who came after", || {
        late.heard("image").len() > 30 && !late.heard("mask").is_empty()
    });
    probe.more(30);
    // All in order, whatever happened.
    let stamps = probe.stamps();
    assert!(stamps.is_sorted_by(|one, next| one < next), "{stamps:?}");
    early.report("driver", |report| report["level"] == 0 && report["values"]["state"] == "streaming");
}

#[test]
fn each_lost_frame_is_black_where_gaps_are_filled() {
    let stage = masked(
        ", faults = [{ kind = \"lost\", at_frame = 120, count = 3 }, { kind = \"incomplete\", at_frame = 150, count = 1 }, \
         { kind = \"lost\", at_frame = 180, count = 6 }]",
    );
    let ros = Ros::new(&stage);
    let _master = ros.master();
    let _manager = ros.manager();
    let (_probe, probe) = ros.probe();
    let _camera = ros.camera(&["_fill_lost:=5"]);
    let (_listener, listener) = ros.listener("listener");
    // The camera is there before its frames.
    listener.report("driver", |_| true);
    let mut subscriber = stage.subscriber("left");
    let _driver = stage.driver();
    let mut gaps = Vec::new();
    let mut before = None;
    while gaps.len() < 3 {
        let frame = next_frame(&mut subscriber);
        let stamp = frame.header().mid_exposure_realtime_ns;
        if frame.lost_before() > 0 {
            gaps.push((frame.lost_before(), before.unwrap(), stamp));
        }
        before = Some(stamp);
    }
    assert_eq!(gaps.iter().map(|gap| gap.0).collect::<Vec<_>>(), [3, 1, 6]);
    wait_until("the frame after the last gap", || probe.stamps().contains(&gaps[2].2));
    let seen = probe.seen();
    for (lost, begin, end) in gaps {
        let filled: Vec<&Seen> = seen.iter().filter(|seen| begin < seen.stamp && seen.stamp < end).collect();
        // The last gap is longer than what is to be filled.
        let expected = if lost > 5 { 0 } else { lost };
        assert_eq!(filled.len() as u64, expected);
        for (place, black) in (1..).zip(filled) {
            let even = begin + (end - begin) * place / (lost + 1);
            assert!(
                black.is_black && black.stamp.abs_diff(even) < 50_000,
                "{place}: {} is not {even}",
                black.stamp
            );
        }
    }
    assert_eq!(seen.iter().filter(|seen| seen.is_black).count(), 4);
    assert!(seen.is_sorted_by(|one, next| one.stamp < next.stamp));
    let report = listener.report("frames", |report| report["values"]["lost"] == "10");
    assert_eq!(report["values"]["black in place of lost"], "4", "{report}");
}

#[test]
fn frames_that_show_the_airframe_are_refused_unless_allowed() {
    let attached = simulated("left", "left.png", "") + "mask_mode = \"attach\"\n";
    for cameras in [attached, simulated("left", "none", "")] {
        let stage = Stage::new(&(ROOM.to_owned() + &cameras));
        stage.write_mask("left.png", SIZE, MASKED_ROWS);
        let ros = Ros::new(&stage);
        let _master = ros.master();
        let _driver = stage.driver();
        let _manager = ros.manager();
        let (_probe, probe) = ros.probe();
        let camera = ros.camera(&[]);
        let (_listener, listener) = ros.listener("listener");
        let refused =
            |report: &Value| report["values"]["refused"].as_str().unwrap().parse::<u64>().unwrap() > 60;
        let report = listener.report("frames", refused);
        assert_eq!(report["level"], 2, "{report}");
        assert!(report["message"].as_str().unwrap().contains("allow_unmasked"), "{report}");
        assert_eq!(report["values"]["published"], "0", "{report}");
        assert!(probe.seen().is_empty());
        unload(camera);
        let _camera = ros.camera(&["_allow_unmasked:=true"]);
        probe.more(30);
    }
}

#[test]
fn the_node_publishes_deeper_formats_and_tells_what_it_cannot_use() {
    let cameras = simulated("left", "left.png", "") + "pixel_format = \"Mono12\"\n";
    let stage = Stage::new(&(ROOM.to_owned() + &cameras));
    stage.write_mask("left.png", SIZE, MASKED_ROWS);
    let ros = Ros::new(&stage);
    let _master = ros.master();
    let _driver = stage.driver();
    let program = prefix().join("lib/uvcam_ros/camera_node");
    let node = Process::start(ros.command(&program).args(ros.camera_words()));
    let (_listener, listener) = ros.listener("listener");
    wait_until("images of the node", || listener.heard("image").len() > 10);
    for image in listener.heard("image") {
        assert_eq!(image["shape"], serde_json::json!(["mono16", 752, 480, 1504, 0]));
        assert_eq!(
            (&image["bytes"], &image["first_black_row"]),
            (&(1504 * 480).into(), &(480 - MASKED_ROWS).into())
        );
    }
    node.signal(Signal::INT);
    assert!(node.finish().status.success());

    for (word, told) in [
        (
            "_wakeup:=soon",
            "/uav1/uvdar_bluefox/left/wakeup = \"soon\" is not \"futex\", \"predictive\" or \"event\"",
        ),
        ("_fill_lost:=61", "/uav1/uvdar_bluefox/left/fill_lost = 61 is not from 0 to 60"),
        ("_camera:=25003774", "/uav1/uvdar_bluefox/left/camera is not a string (type=\"string\")"),
    ] {
        // The master keeps parameters.
        let ros = Ros::new(&stage);
        let _master = ros.master();
        let output = Process::start(ros.command(&program).args(ros.camera_words()).arg(word)).finish();
        assert_eq!(output.status.code(), Some(1), "{word}");
        assert!(stderr(&output).contains(told), "{word}: {}", stderr(&output));
    }
}

#[test]
fn cmake_finds_what_it_needs_without_catkin() {
    configure(&package(), "plain", &["-DCMAKE_DISABLE_FIND_PACKAGE_catkin=ON"]);
}

#[test]
fn the_example_launch_file_starts_what_uvdar_needs() {
    let cameras: String = ["left", "right", "back"].map(|name| simulated(name, "{camera}.png", "")).concat();
    let stage = Stage::new(&(ROOM.to_owned() + &cameras));
    for name in ["left", "right", "back"] {
        stage.write_mask(&format!("{name}.png"), SIZE, MASKED_ROWS);
    }
    let ros = Ros::new(&stage);
    let _driver = stage.driver();
    let settings = stage.settings();
    let mut launch = ros.command("/usr/bin/roslaunch");
    launch.args(["-p", &ros.port.to_string()]).arg(package().join("launch/uvdar_cameras.launch"));
    launch.args(["uav_name:=uav1", "start_manager:=true"]).arg(format!("prefix:={}", settings.prefix));
    launch.arg(format!("root_path:={}", settings.root_path.display()));
    let _launched = Launched(Some(Process::start(&mut launch)));
    wait_until("a master that listens", || TcpStream::connect(("127.0.0.1", ros.port)).is_ok());
    for name in ["left", "right", "back"] {
        let (_listener, listener) = ros.listener_of(name, &format!("/uav1/uvdar_bluefox/{name}"));
        wait_until("images", || listener.heard("image").len() > 10);
        assert_eq!(listener.heard("image")[0]["frame_id"], format!("uav1/uvcam_{name}"));
    }
}

#[test]
fn the_package_has_the_version_of_the_others() {
    let manifest = std::fs::read_to_string(package().join("package.xml")).unwrap();
    assert!(manifest.contains(concat!("<version>", env!("CARGO_PKG_VERSION"), "</version>")));
}
