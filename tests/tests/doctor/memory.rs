//! Memory that is locked, and memory that is shared.

use std::os::unix::fs::chown;

use super::*;

#[test]
fn finds_a_limit_of_locked_memory() {
    finds("locked_memory", "warning", "memlock unlimited", |machine| machine.write_limits("8388608", "50"));
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
