//! Cameras in a system where no udevd tells anyone of new devices, as in a container: the kernel lists them in sysfs, and makes their
//! nodes. Runs in a machine of its own.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use uvcam_emulated::usb::{Device, Plugged};
use uvcam_emulated::{usb3_vision, uvc};
use uvcam_tests::{Stage, next_frame, stderr, wait_until};

/// The longest time from the return of a camera to its first good frame.
const RECOVERY: Duration = Duration::from_secs(1);
const CYCLES: u64 = 3;

fn configuration(source: &str) -> String {
    format!(
        "[[camera]]\nname = \"left\"\nsource = {{ {source} }}\nwidth = 640\nheight = 480\nfps = 60\nexposure_us = 1000\n\
         mask = \"none\"\n"
    )
}

/// Video devices that the kernel has.
fn video_nodes() -> usize {
    fs::read_dir("/sys/class/video4linux").unwrap().count()
}

/// Pulls the plug of a camera that flies, again and again.
fn is_found_again<D: Device>(first: Plugged<D>, kind: &str, source: &str, new: impl Fn() -> D) {
    assert!(!Path::new("/run/udev/control").exists(), "this machine has an udevd");
    let mut device = first;
    let stage = Stage::new(&configuration(source));
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);
    let mut longest = Duration::ZERO;
    for cycle in 1..=CYCLES {
        device.unplug();
        // Twice at once, then after the driver has looked for it for a while.
        if cycle == CYCLES {
            std::thread::sleep(Duration::from_secs(3));
        }
        device = Plugged::new(new());
        let plugged = Instant::now();
        while !next_frame(&mut subscriber).epoch_changed() {}
        longest = longest.max(plugged.elapsed());
        assert_eq!(subscriber.epochs(), cycle + 1);
        for _ in 0..30 {
            next_frame(&mut subscriber);
        }
    }
    println!(
        "\n| {kind} without udevd, {CYCLES} times plugged in again | new epochs | {} | {:.2} |",
        subscriber.lost(),
        longest.as_secs_f64()
    );
    assert_eq!(subscriber.lost(), 0);
    assert!(longest < RECOVERY, "{longest:?}");
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn a_replugged_usb3_vision_camera_is_found_again() {
    let new = || usb3_vision::Camera::new(usb3_vision::Identity::with_serial("U3V1"));
    is_found_again(Plugged::new(new()), "USB3 Vision", "kind = \"aravis\", serial = \"U3V1\"", new);
}

#[test]
fn a_replugged_camera_of_the_kernel_is_found_again() {
    let others = video_nodes();
    let first = Plugged::new(uvc::Camera::new("UVC1"));
    wait_until("the kernel has made its node", || video_nodes() > others);
    is_found_again(first, "UVC", "kind = \"v4l2\", serial = \"UVC1\"", || uvc::Camera::new("UVC1"));
}

#[test]
fn a_camera_whose_node_a_container_lacks_is_named_with_the_cause() {
    let _device = Plugged::new(usb3_vision::Camera::new(usb3_vision::Identity::with_serial("U3V1")));
    // What a container sees that was given the nodes of the devices of its start.
    let mount = |arguments: &[&str]| {
        assert!(
            std::process::Command::new("mount").args(arguments).status().unwrap().success(),
            "{arguments:?}"
        );
    };
    mount(&["-t", "tmpfs", "none", "/dev/bus/usb"]);
    let output = Stage::new(&configuration("kind = \"aravis\", serial = \"U3V1\"")).driver().finish();
    assert!(std::process::Command::new("umount").arg("/dev/bus/usb").status().unwrap().success());
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(4), "{text}");
    assert!(
        text.contains("found: the camera at USB ") && text.contains("-v /dev/bus/usb:/dev/bus/usb"),
        "{text}"
    );
}
