//! `uvcam doctor` on planted machines: folders that hold what `/proc`, `/sys`, `/dev` and `/etc` of a machine say.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::path::PathBuf;

use rustix::fs::{XattrFlags, setxattr};
use serde_json::Value;
use uvcam_tests::{Stage, simulated, stderr};

/// The user who runs the driver there; never the one who runs the tests.
const USER: u32 = 4242;
/// Places on USB of a Basler, an mvBlueFOX3 and an mvBlueFOX.
const PLACES: [&str; 3] = ["4-1", "4-2", "3-1"];

/// Where the kernel's camera is.
const VIDEO_NODE: &str = "dev/video2";

#[path = "doctor/cameras.rs"]
mod cameras;

/// A machine with three cameras on USB, one of the kernel, one on the network and a simulated one, on which nothing is wrong.
struct Machine {
    stage: Stage,
    cameras: String,
}

impl Machine {
    fn healthy() -> Self {
        let camera = |name: &str, serial: &str| {
            format!(
                "[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"aravis\", serial = \"{serial}\" }}\n\
                 width = 752\nheight = 480\nfps = 59.9\nexposure_us = 1000\nmask = \"{name}.png\"\n"
            )
        };
        let cameras = camera("left", "Basler-acA-1001")
            + &camera("right", "1002")
            + &camera("back", "1003")
            + "[camera.realtime]\npriority = 40\n"
            + &camera("network", "192.168.0.7")
            + "[[camera]]\nname = \"below\"\nsource = { kind = \"v4l2\", path = \"/dev/v4l/by-id/usb-below\" }\n\
               width = 640\nheight = 480\nfps = 30\nexposure_us = 1000\nmask = \"none\"\n"
            + &simulated("drawn", "none", "");
        let machine = Machine { stage: Stage::new(""), cameras };
        for name in ["left", "right", "back", "network"] {
            machine.stage.write_mask(&format!("{name}.png"), (752, 480), 40);
        }
        for (index, (vendor, product, bus, speed)) in [
            ("2676", "acA1920-155um", 4, 5000),
            ("164c", "mvBlueFOX3-2004G", 4, 5000),
            ("164c", "mvBlueFOX-MLC200wG", 3, 480),
        ]
        .into_iter()
        .enumerate()
        {
            let device = format!("sys/bus/usb/devices/{}", PLACES[index]);
            let serial = (1001 + index).to_string();
            machine.write(&format!("{device}/idVendor"), vendor);
            machine.write(&format!("{device}/product"), product);
            machine.write(&format!("{device}/serial"), &serial);
            machine.write(&format!("{device}/busnum"), &bus.to_string());
            machine.write(&format!("{device}/devnum"), &(index + 2).to_string());
            machine.write(&format!("{device}/speed"), &speed.to_string());
            machine.write(&format!("sys/bus/usb/devices/usb{bus}/speed"), &speed.to_string());
            if speed == 5000 {
                machine.write(&format!("{device}:1.0/bInterfaceClass"), "ef");
                machine.write(&format!("{device}:1.0/bInterfaceSubClass"), "05");
            }
            let node = format!("dev/bus/usb/{bus:03}/{:03}", index + 2);
            machine.write(&node, "");
            machine.set_mode(&node, 0o660);
        }
        machine.write(VIDEO_NODE, "");
        machine.set_mode(VIDEO_NODE, 0o660);
        fs::create_dir_all(machine.path("dev/v4l/by-id")).unwrap();
        symlink("../../video2", machine.path("dev/v4l/by-id/usb-below")).unwrap();
        // Something on USB that is no camera.
        machine.write("sys/bus/usb/devices/3-2/idVendor", "046d");
        machine.write("sys/bus/usb/devices/3-2/speed", "12");

        let group = fs::metadata(machine.path("dev/bus/usb/004/002")).unwrap().gid();
        machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "16");
        machine.write("etc/passwd", &format!("pilot:x:{USER}:{USER}::/home/pilot:/bin/sh"));
        machine.write("etc/udev/rules.d/70-uvcam.rules", include_str!("../../udev/70-uvcam.rules"));
        machine.write("proc/sys/net/core/rmem_max", "8000000");
        machine
            .write("etc/nftables.conf", "iifname \"eth1\" meta l4proto udp ip saddr != { 192.168.0.7 } drop");
        machine.write("proc/self/status", &status(USER, &format!("7 {group}")));
        machine.write_limits("unlimited", "50");
        machine.write("proc/700/comm", "bash");
        fs::create_dir_all(machine.path("proc/700/fd")).unwrap();
        symlink("/dev/null", machine.path("proc/700/fd/0")).unwrap();
        fs::create_dir_all(machine.path("dev/shm")).unwrap();
        for processor in 0..2 {
            let folder = format!("sys/devices/system/cpu/cpu{processor}/cpufreq");
            machine.write(&format!("{folder}/scaling_governor"), "performance");
        }
        machine.write("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc");
        machine
            .write("sys/devices/system/clocksource/clocksource0/available_clocksource", "tsc hpet acpi_pm");
        machine
    }

    fn path(&self, name: &str) -> PathBuf {
        self.stage.file("root").join(name)
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }

    fn set_mode(&self, name: &str, mode: u32) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(mode)).unwrap();
    }

    /// `/proc/self/limits`, as proc_pid_limits(5) describes it.
    fn write_limits(&self, locked_memory: &str, real_time_priority: &str) {
        let text = format!(
            "Limit                     Soft Limit           Hard Limit           Units\n\
             Max locked memory         {locked_memory}      {locked_memory}      bytes\n\
             Max realtime priority     {real_time_priority} {real_time_priority}\n"
        );
        self.write("proc/self/limits", &text);
    }

    fn configure(&mut self, from: &str, to: &str) {
        assert!(self.cameras.contains(from), "{from}");
        self.cameras = self.cameras.replacen(from, to, 1);
    }

    /// The exit code, and the findings.
    fn examine(&self) -> (Option<i32>, Vec<Value>) {
        let config = self.stage.file("uvcam.toml");
        let ipc = fs::read_to_string(&config).unwrap();
        fs::write(&config, ipc + &self.cameras).unwrap();
        let output = self.stage.output(&["doctor", "--json", "--root", self.path("").to_str().unwrap()]);
        let report: Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(&output)));
        assert_eq!(report["healthy"], output.status.success(), "{report}");
        (output.status.code(), report["findings"].as_array().unwrap().clone())
    }
}

/// `/proc/PID/status` of a process without capabilities, as proc_pid_status(5) describes it.
fn status(user: u32, groups: &str) -> String {
    format!("Uid:\t{user}\t{user}\t{user}\t{user}\nGid:\t1\t1\t1\t1\nGroups:\t{groups}\nCapEff:\t0\n")
}

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

#[test]
fn finds_a_limit_of_locked_memory() {
    finds("locked_memory", "warning", "memlock unlimited", |machine| machine.write_limits("8388608", "50"));
}

#[test]
fn finds_that_a_configured_real_time_priority_is_not_allowed() {
    finds("real_time_priority", "warning", "rtprio", |machine| machine.write_limits("unlimited", "39"));
}

#[test]
fn finds_slots_that_shared_memory_does_not_hold() {
    finds("shared_memory", "fault", "remount,size=", |machine| {
        // 11 TB.
        machine.cameras.insert_str(0, "max_subscribers = 64\nbuffer = 256\nborrowed = 64\n");
        let small = simulated("drawn", "none", "");
        let large = small.replace("width = 752\nheight = 480\n", "width = 16384\nheight = 16384\n");
        machine.configure(&small, &(large + "pixel_format = \"Mono16\"\n"));
    });
}

#[test]
fn finds_that_shared_memory_is_absent() {
    finds("shared_memory", "fault", "--ipc=host, or --shm-size=", |machine| {
        fs::remove_dir(machine.path("dev/shm")).unwrap();
    });
}

#[test]
fn finds_a_root_path_of_another_user() {
    finds("root_path", "fault", "sudo rm -r /", |machine| {
        // It belongs to the user who runs the tests.
        let root_path = machine.stage.settings().root_path;
        fs::create_dir_all(machine.path(root_path.to_str().unwrap().trim_start_matches('/'))).unwrap();
    });
}

#[test]
fn root_is_warned_of_a_root_path_that_others_use() {
    finds("root_path", "warning", "sudo -u 4242", |machine| {
        let root_path = machine.stage.settings().root_path;
        let root_path = machine.path(root_path.to_str().unwrap().trim_start_matches('/'));
        fs::create_dir_all(&root_path).unwrap();
        chown(root_path, Some(USER), None).expect("run the tests as root: a file must change its owner");
        machine.write("etc/passwd", "root:x:0:0::/root:/bin/sh");
        machine.write("proc/self/status", &status(0, "0").replace("CapEff:\t0", "CapEff:\t1ffffffffff"));
    });
}

#[test]
fn finds_that_logind_removes_the_shared_memory_of_a_user() {
    let logind = |machine: &Machine| fs::create_dir_all(machine.path("run/systemd/users")).unwrap();
    let remedy = "RemoveIPC=no";
    finds("ipc_removal", "warning", remedy, |machine| logind(machine));
    finds("ipc_removal", "warning", remedy, |machine| {
        logind(machine);
        machine.write("etc/systemd/logind.conf", "[Login]\n#RemoveIPC=no\nRemoveIPC=no");
        machine.write("etc/systemd/logind.conf.d/50-site.conf", "[Login]\nRemoveIPC = yes");
    });
}

#[test]
fn logind_that_keeps_the_shared_memory_is_no_finding() {
    let machine = Machine::healthy();
    fs::create_dir_all(machine.path("run/systemd/users")).unwrap();
    machine.write("usr/lib/systemd/logind.conf.d/10-vendor.conf", "[Login]\nRemoveIPC=yes");
    machine.write("etc/systemd/logind.conf.d/70-uvcam.conf", "[Login]\nRemoveIPC=no");
    assert_eq!(machine.examine(), (Some(0), Vec::new()));
}

#[test]
fn logind_leaves_the_shared_memory_of_system_users_alone() {
    let machine = Machine::healthy();
    fs::create_dir_all(machine.path("run/systemd/users")).unwrap();
    let text = fs::read_to_string(machine.path("proc/self/status")).unwrap();
    machine.write("proc/self/status", &text.replace(&USER.to_string(), "998"));
    assert_eq!(machine.examine(), (Some(0), Vec::new()));
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
