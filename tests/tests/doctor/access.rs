//! Who may open a camera, who holds it, and whether it is there.

use rustix::fs::{XattrFlags, setxattr};

use super::*;

#[test]
fn finds_a_device_node_that_the_user_may_not_open() {
    finds("device_access", "fault", "sudo u", |machine| {
        machine.set_mode("dev/bus/usb/004/003", 0o600);
    });
}

#[test]
fn a_device_node_may_be_opened_by_whom_its_access_list_names() {
    let machine = Machine::healthy();
    let node = "dev/bus/usb/004/003";
    machine.set_mode(node, 0o600);
    // acl(5), as the kernel keeps it: version 2; then tag, permissions (4 read, 2 write) and user of the owner, a user, the group, the
    // mask and all others.
    let nobody = u32::MAX;
    let entries: [(u16, u16, u32); 5] =
        [(1, 6, nobody), (2, 6, USER), (4, 0, nobody), (16, 6, nobody), (32, 0, nobody)];
    let mut list = 2_u32.to_le_bytes().to_vec();
    for (tag, permissions, user) in entries {
        list.extend([tag.to_le_bytes(), permissions.to_le_bytes()].concat());
        list.extend(user.to_le_bytes());
    }
    setxattr(machine.path(node), "system.posix_acl_access", &list, XattrFlags::empty()).unwrap();
    machine.write("proc/self/status", &status(USER, "7"));
    for other in ["dev/bus/usb/004/002", "dev/bus/usb/003/004", VIDEO_NODE] {
        machine.set_mode(other, 0o600);
    }
    let (_, findings) = machine.examine();
    let places: Vec<bool> =
        findings.iter().map(|finding| finding["finding"].as_str().unwrap().contains("4-2")).collect();
    assert_eq!(places, [false, false, false], "{findings:#?}");
}

#[test]
fn finds_a_device_node_that_everyone_may_open() {
    finds("device_access", "warning", "udevadm trigger", |machine| {
        machine.set_mode("dev/bus/usb/004/003", 0o666);
    });
}

#[test]
fn finds_that_no_udev_rule_is_installed() {
    finds("udev_rule", "warning", "/etc/udev/rules.d/", |machine| {
        let rules = machine.path("etc/udev/rules.d/70-uvcam.rules");
        let text = fs::read_to_string(&rules).unwrap();
        machine.write(
            "etc/udev/rules.d/70-uvcam.rules",
            &text.replace("\"2676\"", "\"0000\"").replace("ef05", ""),
        );
    });
}

#[test]
fn finds_another_program_that_holds_a_camera() {
    finds("device_holder", "fault", "kill 700", |machine| {
        symlink("/dev/bus/usb/004/002", machine.path("proc/700/fd/5")).unwrap();
    });
}

#[test]
fn finds_a_video_node_that_the_user_may_not_open() {
    finds("device_access", "fault", "sudo u", |machine| machine.set_mode(VIDEO_NODE, 0o600));
}

#[test]
fn finds_another_program_that_holds_a_video_node() {
    finds("device_holder", "warning", "kill 700", |machine| {
        symlink("/dev/video2", machine.path("proc/700/fd/5")).unwrap();
    });
}

#[test]
fn finds_that_a_video_node_is_not_there() {
    finds("connected", "fault", "uvcam list", |machine| {
        fs::remove_file(machine.path(VIDEO_NODE)).unwrap();
    });
}

#[test]
fn a_video_node_is_found_by_the_serial_of_its_usb_device() {
    finds("device_access", "fault", "sudo u", |machine| {
        machine.configure("path = \"/dev/v4l/by-id/usb-below\"", "serial = \"1004\"");
        machine.write("sys/devices/usb3/3-3/serial", "1004");
        fs::create_dir_all(machine.path("sys/devices/usb3/3-3/3-3:1.0")).unwrap();
        // The first of two nodes carries frames, the other data about them.
        for (node, index) in [("video3", "1"), ("video2", "0")] {
            machine.write(&format!("sys/class/video4linux/{node}/index"), index);
            let device = format!("sys/class/video4linux/{node}/device");
            symlink("../../../devices/usb3/3-3/3-3:1.0", machine.path(&device)).unwrap();
        }
        machine.set_mode(VIDEO_NODE, 0o600);
    });
}
