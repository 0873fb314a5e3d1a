//! How cameras are named, reached, and kept from others.

use super::*;

#[test]
fn finds_a_camera_that_is_named_by_the_number_of_its_node() {
    for (folder, link) in [("by-id", "usb-below"), ("by-path", "pci-0000:00:14.0-usb-0:1:1.0-video-index0")] {
        finds("device_name", "warning", &format!("path = \"/dev/v4l/{folder}/{link}\""), |machine| {
            machine.configure("path = \"/dev/v4l/by-id/usb-below\"", "path = \"/dev/video2\"");
            if folder == "by-path" {
                fs::remove_file(machine.path("dev/v4l/by-id/usb-below")).unwrap();
                fs::create_dir_all(machine.path("dev/v4l/by-path")).unwrap();
                symlink("../../video2", machine.path(&format!("dev/v4l/by-path/{link}"))).unwrap();
            }
        });
    }
    finds("device_name", "warning", "write its serial", |machine| {
        machine.configure("path = \"/dev/v4l/by-id/usb-below\"", "path = \"/dev/video2\"");
        fs::remove_dir_all(machine.path("dev/v4l")).unwrap();
    });
}

#[test]
fn finds_that_no_rule_keeps_others_from_a_camera_network() {
    // As the kernel writes it: a default route, and the camera's network.
    let word = |address: [u8; 4]| format!("{:08X}", u32::from_ne_bytes(address));
    let route = |interface: &str, network, mask| {
        format!("{interface}\t{}\t00000000\t0001\t0\t0\t0\t{}\t0\t0\t0\n", word(network), word(mask))
    };
    let routes = String::from("Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\n")
        + &route("wlan0", [0; 4], [0; 4])
        + &route("cam0", [192, 168, 0, 0], [255, 255, 255, 0]);
    let rule = "iifname \"cam0\" meta l4proto udp ip saddr != { 192.168.0.7 } drop";
    for rules in ["", "flush ruleset", "ip saddr != 192.168.0.77 drop"] {
        finds("firewall", "unknown", rule, |machine| {
            machine.write("proc/net/route", &routes);
            machine.write("etc/nftables.conf", rules);
        });
    }
    let machine = Machine::healthy();
    machine.write("etc/nftables.conf", "include \"/etc/nftables.d/*\"");
    machine.write("etc/nftables.d/cameras.nft", rule);
    assert_eq!(machine.examine(), (Some(0), Vec::new()));
}

#[test]
fn finds_that_a_container_lacks_the_node_of_a_camera() {
    finds("device_access", "fault", "-v /dev/bus/usb:/dev/bus/usb", |machine| {
        fs::remove_file(machine.path("dev/bus/usb/004/003")).unwrap();
    });
}

#[test]
fn what_a_device_calls_itself_controls_no_terminal() {
    let machine = Machine::healthy();
    machine.write("sys/bus/usb/devices/4-2/speed", "480");
    machine.write("sys/bus/usb/devices/4-2/product", "mvBlueFOX3\u{1b}[2J\u{7}");
    let (_, findings) = machine.examine();
    let finding = findings[0]["finding"].as_str().unwrap();
    assert!(finding.starts_with("camera mvBlueFOX3\u{fffd}[2J\u{fffd} serial"), "{finding}");
}
