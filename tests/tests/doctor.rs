//! `uvcam doctor` on planted machines.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::os::unix::fs::symlink;

use uvcam_tests::simulated;

use machine::{Machine, USER, VIDEO_NODE, status};

#[path = "doctor/access.rs"]
mod access;
#[path = "doctor/cameras.rs"]
mod cameras;
#[path = "doctor/drivers.rs"]
mod drivers;
#[path = "doctor/machine.rs"]
mod machine;
#[path = "doctor/memory.rs"]
mod memory;

/// Plants one thing that is wrong on a healthy machine. The doctor must find it, with these words in its remedy, and find
/// nothing else.
#[track_caller]
fn finds(check: &str, severity: &str, remedy: &str, plant: impl FnOnce(&mut Machine)) {
    let mut machine = Machine::healthy();
    plant(&mut machine);
    let (code, findings) = machine.examine();
    assert_eq!(findings.len(), 1, "{findings:#?}");
    let finding = &findings[0];
    assert_eq!((&finding["check"], &finding["severity"]), (&check.into(), &severity.into()), "{finding}");
    assert!(finding["remedy"].as_str().unwrap().contains(remedy), "{finding}");
    assert_eq!(code, Some(if severity == "fault" { 6 } else { 0 }));
}

#[test]
fn a_healthy_machine_has_no_finding() {
    assert_eq!(Machine::healthy().examine(), (Some(0), Vec::new()));
}

#[test]
fn finds_usb_memory_below_the_slots() {
    finds("usbfs_memory", "warning", "echo 256 | sudo tee /sys/module/usbcore", |machine| {
        machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "4");
    });
}

#[test]
fn finds_usb_memory_below_one_frame_of_each_camera() {
    finds("usbfs_memory", "fault", "echo 256 | sudo tee /sys/module/usbcore", |machine| {
        machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "1");
    });
}

#[test]
fn finds_a_usb3_camera_on_a_usb2_link() {
    finds("usb_link", "fault", "USB 3 cable", |machine| {
        machine.write("sys/bus/usb/devices/4-2/speed", "480");
    });
}

#[test]
fn finds_cameras_that_exceed_their_controller() {
    finds("usb_bandwidth", "fault", "another controller", |machine| {
        machine.configure("fps = 59.9", "fps = 590");
        machine.configure("fps = 59.9", "fps = 590");
    });
}

#[test]
fn finds_that_a_configured_real_time_priority_is_not_allowed() {
    finds("real_time_priority", "warning", "rtprio", |machine| machine.write_limits("unlimited", "39"));
}

#[test]
fn finds_a_saving_cpu_governor() {
    finds("cpu_governor", "warning", "echo performance | sudo tee", |machine| {
        machine.write("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave");
    });
}

#[test]
fn finds_a_slow_clock_source() {
    finds("clock_source", "warning", "echo tsc | sudo tee", |machine| {
        machine.write("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet");
    });
}

#[test]
fn finds_a_missing_mask() {
    finds("mask", "fault", "uvcam generate right", |machine| {
        fs::remove_file(machine.stage.file("right.png")).unwrap();
    });
}

#[test]
fn finds_a_mask_of_another_size() {
    finds("mask", "fault", "uvcam generate back", |machine| {
        machine.stage.write_mask("back.png", (640, 480), 40);
    });
}

#[test]
fn finds_frames_that_are_not_blanked() {
    finds("mask", "warning", "mask_mode = \"blank\"", |machine| {
        machine.configure("mask = \"left.png\"", "mask = \"left.png\"\nmask_mode = \"attach\"");
    });
}

#[test]
fn finds_an_exposure_that_does_not_fit_the_readout() {
    // 59.9 fps leave an mvBlueFOX 5.8 ms, and any other camera a frame period.
    finds("exposure", "fault", "is 5823", |machine| {
        machine.configure(
            "serial = \"1003\" }\nwidth = 752\nheight = 480\nfps = 59.9\nexposure_us = 1000",
            "serial = \"1003\" }\nwidth = 752\nheight = 480\nfps = 59.9\nexposure_us = 5900",
        );
    });
    finds("exposure", "fault", "is 16694", |machine| {
        machine.configure("exposure_us = 1000", "exposure_us = 17000");
    });
}

#[test]
fn finds_a_socket_that_is_too_small_for_gige_vision() {
    finds("socket_buffer", "warning", "net.core.rmem_max=2887680", |machine| {
        machine.write("proc/sys/net/core/rmem_max", "212992");
    });
}

#[test]
fn says_that_an_absent_camera_was_not_examined() {
    finds("connected", "unknown", "uvcam list", |machine| {
        machine.configure("serial = \"1002\"", "serial = \"9999\"");
    });
}

#[test]
fn a_running_driver_is_examined_in_place_of_the_user() {
    let machine = Machine::healthy();
    machine.write("proc/800/comm", "uvcam");
    machine.write("proc/800/cmdline", "/usr/bin/uvcam\0run\0--config\0/etc/uvcam/uvcam.toml\0");
    machine.write("etc/uvcam/uvcam.toml", &machine.configuration());
    machine.write("proc/800/status", &status(4343, "7"));
    machine.write("proc/800/limits", "Max realtime priority     0     0\n");
    fs::create_dir_all(machine.path("proc/800/fd")).unwrap();
    symlink("/dev/bus/usb/004/002", machine.path("proc/800/fd/5")).unwrap();
    // The process of a camera, which may have the lower number.
    machine.write("proc/799/comm", "uvcam");
    machine.write("proc/799/cmdline", "/usr/bin/uvcam\0run\0--camera\0left\0--main-process\0800\0");
    let (code, findings) = machine.examine();
    let checks: Vec<&str> = findings.iter().map(|finding| finding["check"].as_str().unwrap()).collect();
    assert_eq!(code, Some(6));
    assert_eq!(checks, ["device_access"; 4].into_iter().chain(["real_time_priority"]).collect::<Vec<_>>());
    assert!(findings[0]["finding"].as_str().unwrap().contains("process 800"), "{findings:#?}");
}

#[test]
fn the_table_names_the_finding_and_its_remedy() {
    let machine = Machine::healthy();
    machine.write("sys/bus/usb/devices/4-2/speed", "480");
    machine.examine();
    let output = machine.stage.output(&["doctor", "--root", machine.path("").to_str().unwrap()]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("fault: camera mvBlueFOX3-2004G serial 1002 at USB 4-2"), "{text}");
    assert_eq!(text.lines().count(), 2, "{text}");
}
