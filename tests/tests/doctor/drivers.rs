//! Whose driver runs: several may, and a configuration has one at most.

use std::fs;
use std::os::unix::fs::{chown, symlink};

use serde_json::Value;
use uvcam_tests::{Stage, next_frame, simulated};

use super::finds;
use super::machine::{Machine, USER, status};

/// A process `id` of user 4343 with this command line, its words separated by spaces.
fn plant(machine: &Machine, id: u32, line: &str) {
    machine.write(&format!("proc/{id}/comm"), "uvcam");
    machine.write(&format!("proc/{id}/cmdline"), &(line.replace(' ', "\0") + "\0"));
    machine.write(&format!("proc/{id}/status"), &(status(4343, "7") + "PPid:\t1\n"));
}

/// The process that may not open cameras of the machine, in words.
fn accused(machine: &Machine) -> String {
    machine.set_mode("dev/bus/usb/004/003", 0o600);
    let (_, findings) = machine.examine();
    let finding = findings.iter().find(|finding| finding["check"] == "device_access").unwrap();
    finding["finding"].as_str().unwrap().to_owned()
}

#[test]
fn the_running_driver_is_the_one_whose_configuration_is_about_the_same_cameras() {
    for (line, is_ours) in [
        ("/usr/bin/uvcam run --config /etc/uvcam/uvcam.toml", true),
        ("/usr/bin/uvcam --config=/etc/uvcam/uvcam.toml run", true),
        ("./uvcam run --config uvcam.toml", true),
        ("uvcam run --config /etc/uvcam/edited.toml", true),
        ("uvcam run --config /etc/uvcam/elsewhere.toml", false),
        ("uvcam run --config /etc/uvcam/others.toml", false),
        ("uvcam run --config /etc/uvcam/broken.toml", false),
        ("uvcam run --config /etc/uvcam/absent.toml", false),
        ("uvcam run", false),
        ("uvcam watch left --config /etc/uvcam/uvcam.toml", false),
        ("uvcam run --camera left --main-process 7 --config /etc/uvcam/uvcam.toml", false),
        ("other run --config /etc/uvcam/uvcam.toml", false),
    ] {
        let machine = Machine::healthy();
        let ours = machine.configuration();
        let prefix = machine.stage.settings().prefix;
        machine.write("etc/uvcam/uvcam.toml", &ours);
        machine.write("etc/uvcam/edited.toml", &ours.replace("fps = 59.9", "fps = 30"));
        machine.write("etc/uvcam/elsewhere.toml", &ours.replace(&prefix, "elsewhere_"));
        let address = ours.split("[[camera]]").next().unwrap();
        machine.write("etc/uvcam/others.toml", &(address.to_owned() + &simulated("others", "none", "")));
        machine.write("etc/uvcam/broken.toml", "[[camera");
        plant(&machine, 800, line);
        symlink("../../etc/uvcam", machine.path("proc/800/cwd")).unwrap();
        let accused = accused(&machine);
        assert_eq!(accused.contains("the running driver (process 800"), is_ours, "{line}: {accused}");
    }
}

#[test]
fn a_driver_that_its_environment_tells_of_its_configuration_is_known_as_well() {
    let machine = Machine::healthy();
    machine.write("etc/uvcam/uvcam.toml", &machine.configuration());
    // One of another configuration, which comes first.
    plant(&machine, 799, "uvcam run");
    plant(&machine, 800, "uvcam run");
    machine.write("proc/800/environ", "HOME=/\0UVCAM_CONFIG=/etc/uvcam/uvcam.toml\0");
    let accused = accused(&machine);
    assert!(accused.contains("the running driver (process 800"), "{accused}");
}

#[test]
fn finds_a_driver_of_another_configuration_that_holds_a_camera() {
    finds("device_holder", "fault", "kill 799", |machine| {
        machine.write("etc/uvcam/uvcam.toml", &machine.configuration());
        plant(machine, 799, "uvcam run");
        plant(machine, 800, "uvcam run --config /etc/uvcam/uvcam.toml");
        // Ours has the rights of the user, and a process for each camera.
        let rights = fs::read_to_string(machine.path("proc/self/status")).unwrap();
        machine.write("proc/800/status", &rights);
        plant(machine, 801, "uvcam run --camera left --main-process 800");
        machine.write("proc/801/status", &(rights + "PPid:\t800"));
        for (process, bus) in [(799, "004/002"), (800, "004/003"), (801, "003/004")] {
            fs::create_dir_all(machine.path(&format!("proc/{process}/fd"))).unwrap();
            let node = format!("/dev/bus/usb/{bus}");
            symlink(node, machine.path(&format!("proc/{process}/fd/5"))).unwrap();
        }
    });
}

#[test]
fn each_of_two_drivers_on_one_machine_is_that_of_its_own_configuration() {
    let stages = [(); 2].map(|()| Stage::new(&simulated("left", "none", "")));
    let drivers = stages.each_ref().map(Stage::driver);
    for stage in &stages {
        next_frame(&mut stage.subscriber("left"));
    }
    let words = |stage: &Stage| {
        let root_path = stage.settings().root_path;
        chown(&root_path, Some(USER), None).expect("run the tests as root: a file must change its owner");
        let output = stage.output(&["doctor", "--json"]);
        chown(&root_path, Some(0), None).unwrap();
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let findings = report["findings"].as_array().unwrap();
        let finding = findings.iter().find(|finding| finding["check"] == "root_path").unwrap();
        finding["finding"].as_str().unwrap().to_owned()
    };
    for (stage, driver) in stages.iter().zip(&drivers) {
        let words = words(stage);
        assert!(
            words.contains(&format!("the running driver (process {}, user root)", driver.id())),
            "{words}"
        );
    }
    let [first, second] = drivers;
    first.stop();
    assert!(words(&stages[0]).contains(": user root may"), "{}", words(&stages[0]));
    second.stop();
}
