//! What the rules do, as udev itself applies them: to devices in a `/sys` that exists in a mount namespace only.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;
use uvcam_tests::namespace;

/// The rules, as they are installed.
fn rules() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../udev/70-uvcam.rules").canonicalize().unwrap()
}

/// A `/sys` with one USB device and the USB driver's parameters.
struct Machine {
    root: TempDir,
}

impl Machine {
    const DEVICE: &str = "/sys/devices/usb4/4-1";
    const USBCORE: &str = "/sys/module/usbcore";

    /// `interface` is the class and subclass of the device's only interface.
    fn with_device(vendor: u16, interface: [u8; 2]) -> Self {
        let machine = Machine { root: tempfile::tempdir().unwrap() };
        let [low, high] = vendor.to_le_bytes();
        // USB 3.2, 9.6: the descriptors of a device, a configuration, an interface and a bulk endpoint.
        let device = [18, 1, 0x20, 3, 0xef, 2, 1, 9, low, high, 1, 0, 0, 1, 0, 0, 0, 1];
        let configuration = [9, 2, 25, 0, 1, 1, 0, 0x80, 50];
        let interface = [9, 4, 0, 0, 1, interface[0], interface[1], 0, 0];
        let endpoint = [7, 5, 0x81, 2, 0, 4, 0];
        let descriptors = [&device[..], &configuration, &interface, &endpoint].concat();
        machine.write(&format!("{}/descriptors", Self::DEVICE), &descriptors);
        machine.write(&format!("{}/idVendor", Self::DEVICE), format!("{vendor:04x}\n").as_bytes());
        machine.write(&format!("{}/idProduct", Self::DEVICE), b"0001\n");
        machine.write(&format!("{}/uevent", Self::DEVICE), b"DEVTYPE=usb_device\n");
        machine.write("/sys/bus/usb/uevent", b"");
        symlink("/sys/bus/usb", machine.path(Self::DEVICE).join("subsystem")).unwrap();
        machine.write(&format!("{}/uevent", Self::USBCORE), b"");
        machine
    }

    fn path(&self, absolute: &str) -> PathBuf {
        self.root.path().join(absolute.trim_start_matches('/'))
    }

    fn write(&self, absolute: &str, content: &[u8]) {
        let path = self.path(absolute);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Lets udev treat a device as if it was just added, and returns what it says of our rules and of the device.
    fn add(&self, device: &str) -> String {
        let script = "mount --bind \"$1/sys\" /sys && mount -t tmpfs tmpfs /run && mount -t tmpfs tmpfs /etc/udev/rules.d \
                      && cp \"$2\" /etc/udev/rules.d/ && exec udevadm test --action=add \"$3\" 2>&1";
        let output = Command::new("unshare")
            .args(namespace::options(&["--mount"]))
            .args(["sh", "-c", script, "sh"])
            .args([self.root.path(), &rules(), Path::new(device)])
            .env("SYSTEMD_DEVICE_VERIFY_SYSFS", "0")
            .env("SYSTEMD_LOG_LEVEL", "debug")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            output.status.success(),
            "udevadm (package udev): {said}{}",
            String::from_utf8_lossy(&output.stderr)
        );
        said
    }
}

/// What our rules assign: mode, and the number of the group.
fn assigned(said: &str) -> Option<(String, u32)> {
    let value = |key: &str| {
        let mut ours = said.lines().filter(|line| line.contains("70-uvcam.rules:"));
        ours.find_map(|line| line.split_once(&format!(" {key} "))).map(|(_, value)| value.to_owned())
    };
    Some((value("MODE")?, value("GROUP")?.parse().unwrap()))
}

fn plugdev() -> u32 {
    let groups = fs::read_to_string("/etc/group").unwrap();
    let line = groups.lines().find(|line| line.starts_with("plugdev:")).unwrap();
    line.split(':').nth(2).unwrap().parse().unwrap()
}

#[test]
fn cameras_belong_to_the_group_and_to_nobody_else() {
    // mvBlueFOX (an interface of its own), Basler, and a USB3 Vision device of a vendor without a rule.
    for (vendor, interface) in [(0x164c, [0xff, 0]), (0x2676, [0xef, 5]), (0x1234, [0xef, 5])] {
        let said = Machine::with_device(vendor, interface).add(Machine::DEVICE);
        assert_eq!(assigned(&said), Some(("0660".into(), plugdev())), "{vendor:04x}: {said}");
        assert!(said.contains(":uaccess:"), "{vendor:04x}: {said}");
    }
}

#[test]
fn other_devices_are_left_alone() {
    // A mouse, and a device of a class beside USB3 Vision.
    for (vendor, interface) in [(0x046d, [3, 1]), (0x1234, [0xef, 4])] {
        let said = Machine::with_device(vendor, interface).add(Machine::DEVICE);
        assert_eq!(assigned(&said), None, "{said}");
        assert!(!said.contains(":uaccess:"), "{said}");
    }
}

#[test]
fn the_memory_for_usb_transfers_is_raised_from_the_default_only() {
    for (before, after) in [("16", "256"), ("1000", "1000"), ("0", "0")] {
        let machine = Machine::with_device(0x2676, [0xef, 5]);
        let parameter = format!("{}/parameters/usbfs_memory_mb", Machine::USBCORE);
        machine.write(&parameter, format!("{before}\n").as_bytes());
        let said = machine.add(Machine::USBCORE);
        assert_eq!(fs::read_to_string(machine.path(&parameter)).unwrap().trim(), after, "{said}");
    }
}

#[test]
fn no_rule_opens_a_device_to_everyone() {
    let text = fs::read_to_string(rules()).unwrap();
    let modes: Vec<&str> = text.lines().filter(|line| line.contains("MODE=")).collect();
    assert!(!modes.is_empty());
    assert!(
        modes.iter().all(|line| line.contains("MODE=\"0660\"") && line.contains("GROUP=\"plugdev\"")),
        "{modes:?}"
    );
}
