//! A machine that is planted: folders that hold what `/proc`, `/sys`, `/dev` and `/etc` of one say.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::PathBuf;

use serde_json::Value;
use uvcam_tests::{Stage, simulated, stderr};

/// The user who runs the driver there; never the one who runs the tests.
pub(super) const USER: u32 = 4242;
/// Where the kernel's camera is.
pub(super) const VIDEO_NODE: &str = "dev/video2";
/// Places on USB of a Basler, an mvBlueFOX3 and an mvBlueFOX.
const PLACES: [&str; 3] = ["4-1", "4-2", "3-1"];

/// A machine with three cameras on USB, one of the kernel, one on the network and a simulated one, on which nothing is wrong.
pub(super) struct Machine {
    pub(super) stage: Stage,
    /// Their part of the configuration.
    pub(super) cameras: String,
}

impl Machine {
    pub(super) fn healthy() -> Self {
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
        machine.write("etc/udev/rules.d/70-uvcam.rules", include_str!("../../../udev/70-uvcam.rules"));
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

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.stage.file("root").join(name)
    }

    pub(super) fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }

    pub(super) fn set_mode(&self, name: &str, mode: u32) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(mode)).unwrap();
    }

    /// `/proc/self/limits`, as proc_pid_limits(5) describes it.
    pub(super) fn write_limits(&self, locked_memory: &str, real_time_priority: &str) {
        let text = format!(
            "Limit                     Soft Limit           Hard Limit           Units\n\
             Max locked memory         {locked_memory}      {locked_memory}      bytes\n\
             Max realtime priority     {real_time_priority} {real_time_priority}\n"
        );
        self.write("proc/self/limits", &text);
    }

    pub(super) fn configure(&mut self, from: &str, to: &str) {
        assert!(self.cameras.contains(from), "{from}");
        self.cameras = self.cameras.replacen(from, to, 1);
    }

    /// The text of the configuration.
    pub(super) fn configuration(&self) -> String {
        fs::read_to_string(self.stage.file("uvcam.toml")).unwrap() + &self.cameras
    }

    /// The exit code, and the findings.
    pub(super) fn examine(&self) -> (Option<i32>, Vec<Value>) {
        fs::write(self.stage.file("uvcam.toml"), self.configuration()).unwrap();
        let output = self.stage.output(&["doctor", "--json", "--root", self.path("").to_str().unwrap()]);
        let report: Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(&output)));
        assert_eq!(report["healthy"], output.status.success(), "{report}");
        (output.status.code(), report["findings"].as_array().unwrap().clone())
    }
}

/// `/proc/PID/status` of a process without capabilities, as proc_pid_status(5) describes it.
pub(super) fn status(user: u32, groups: &str) -> String {
    format!("Uid:\t{user}\t{user}\t{user}\t{user}\nGid:\t1\t1\t1\t1\nGroups:\t{groups}\nCapEff:\t0\n")
}
