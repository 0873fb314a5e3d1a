//! Shared memory that is full, read-only, absent, another user's, or removed in flight; limits of the process.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::chown;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use uvcam::config::Config;
use uvcam_tests::{
    Process, Stage, binary, health_where, namespace, next_frame, simulated, stderr, wait_until,
};

/// A user that the tests do not run as.
const NOBODY: u32 = 65534;

fn stage() -> Stage {
    Stage::new(&simulated("left", "none", ""))
}

/// The stage's files in shared memory whose names end so.
fn shared(stage: &Stage, end: &str) -> Vec<PathBuf> {
    let prefix = stage.settings().prefix;
    let files = fs::read_dir("/dev/shm").unwrap().flatten();
    let ours = files.filter(|file| {
        let name = file.file_name();
        let name = name.to_string_lossy();
        name.starts_with(&prefix) && name.ends_with(end)
    });
    ours.map(|file| file.path()).collect()
}

/// Runs a script of sh(1) in namespaces of its own for mounts and processes, with `$U` for the program, `$C` for its configuration, and these arguments.
fn in_namespace(stage: &Stage, script: &str, arguments: &[&str]) -> Output {
    // The doctor examines a running driver, which must not be another test's.
    let namespaces = ["--mount", "--pid", "--fork", "--mount-proc"];
    Command::new("unshare")
        .args(namespace::options(&namespaces))
        .args(["sh", "-c", script, "sh"])
        .args(arguments)
        .env("U", binary())
        .env("C", stage.file("uvcam.toml"))
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

/// Every command that signs in; each says its exit code.
const EVERYONE: &str =
    "for command in 'run --duration 5' 'watch left --frames 5' 'stats left' 'generate left'; do
    timeout 30 $U $command --config $C 2>&1; echo \"exit code $?\"; done; ";

#[track_caller]
fn all_say(output: &Output, count: usize, words: &[&str]) {
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(said.matches("exit code 5").count(), count, "{said}{}", stderr(output));
    assert_eq!(said.matches("exit code").count(), count, "{said}");
    for word in words {
        assert_eq!(said.lines().filter(|line| line.contains(word)).count(), count, "{word}: {said}");
    }
}

#[test]
fn a_full_shared_memory_ends_every_command_with_the_reason() {
    let script =
        "mount -t tmpfs -o size=4M tmpfs /dev/shm && head -c 5M /dev/zero > /dev/shm/full; ".to_owned();
    let output = in_namespace(&stage(), &(script + EVERYONE), &[]);
    all_say(&output, 4, &["/dev/shm is full: 0 kB", "--shm-size or --ipc=host"]);
}

#[test]
fn a_driver_that_flies_is_not_hurt_when_another_program_fills_shared_memory() {
    let stage = stage();
    let script = "mount -t tmpfs -o size=64M tmpfs /dev/shm || exit 99
        $U run --config $C & driver=$!
        $U watch left --config $C --json --timeout 30 > \"$1\" & consumer=$!
        until $U stats left --config $C 2> \"$2\" | grep -q streaming; do sleep 0.1; done
        # That of the main process, which reads health, and that of the consumer.
        until [ \"$(find /dev/shm -name '*.connection' -size +0 | wc -l)\" -ge 2 ]; do sleep 0.1; done
        head -c 64M /dev/zero > /dev/shm/full
        for command in 'watch left --frames 5' 'stats left' 'generate left'; do
            timeout 30 $U $command --config $C 2>&1; echo \"exit code $?\"; done
        rm /dev/shm/full; $U watch left --config $C --frames 30 > \"$2\" && echo back
        kill -INT $consumer; wait $consumer; echo \"consumer $?\"; kill $driver; wait $driver; echo \"driver $?\"";
    let (report, rest) = (stage.file("report.json"), stage.file("rest"));
    let output = in_namespace(&stage, script, &[report.to_str().unwrap(), rest.to_str().unwrap()]);
    // Who cleans up after those that are refused frees a page now and then.
    all_say(&output, 3, &["/dev/shm is full: ", " kB needed"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("back\nconsumer 0\ndriver 0"), "{said}{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    assert_eq!((&report["lost"], &report["epochs"]), (&0.into(), &1.into()), "{report}");
}

#[test]
fn a_read_only_shared_memory_ends_every_command_and_is_found_by_the_doctor() {
    let doctor = "timeout 30 $U doctor --config $C; echo \"doctor $?\"";
    let script = format!("mount -t tmpfs -o ro tmpfs /dev/shm && {EVERYONE}{doctor}");
    let output = in_namespace(&stage(), &script.replace("doctor $?", "finds $?"), &[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("fault: /dev/shm is read-only") && said.contains("finds 6"), "{said}");
    assert!(said.contains("sudo mount -o remount,rw /dev/shm; in a container: --ipc=host"), "{said}");
    all_say(&output, 4, &["/dev/shm cannot be written (Read-only file system"]);
}

#[test]
fn an_absent_shared_memory_ends_every_command_and_is_found_by_the_doctor() {
    let hide = "mount -t tmpfs tmpfs /dev && : > /dev/null; ";
    let output =
        in_namespace(&stage(), &format!("{hide}{EVERYONE}$U doctor --config $C; echo finds $?"), &[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("fault: /dev/shm is absent") && said.contains("finds 6"), "{said}");
    all_say(&output, 4, &["/dev/shm cannot be written", "sudo mount -t tmpfs tmpfs /dev/shm"]);
}

#[test]
fn folders_that_are_closed_to_the_user_are_told() {
    let stage = stage();
    // The program must be where that user can run it.
    fs::copy(binary(), stage.file("uvcam")).unwrap();
    for file in [stage.folder(), &stage.file("uvcam"), &stage.file("uvcam.toml")] {
        chown(file, Some(NOBODY), Some(NOBODY)).expect("run the tests as root: a file must change its owner");
    }
    let config = fs::read_to_string(stage.file("uvcam.toml")).unwrap();
    let root_path = format!("root_path = {:?}", stage.settings().root_path);
    fs::write(stage.file("elsewhere.toml"), config.replace(&root_path, "root_path = \"/usr/uvcam\""))
        .unwrap();
    let script = format!(
        "mount -t tmpfs -o mode=755 tmpfs /dev/shm; cat > \"$1/nobody\" <<'END'
U=\"$1/uvcam\"; {EVERYONE}$U doctor --config $C 2>&1; echo \"finds $?\"
END
        setpriv --reuid={NOBODY} --regid={NOBODY} --clear-groups sh \"$1/nobody\" \"$1\"
        chmod 1777 /dev/shm
        setpriv --reuid={NOBODY} --regid={NOBODY} --clear-groups \"$1/uvcam\" run --config \"$1/elsewhere.toml\" 2>&1"
    );
    let output = in_namespace(&stage, &script, &[stage.folder().to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("user nobody may not write to /dev/shm") && said.contains("finds 6"), "{said}");
    all_say(
        &output,
        4,
        &["/dev/shm cannot be written (Permission denied (os error 13)): sudo chmod 1777 /dev/shm"],
    );
    assert!(said.contains("/usr cannot be written") && said.contains("another root_path"), "{said}");
    assert_eq!(output.status.code(), Some(5), "{said}");
}

#[test]
fn whoever_is_another_user_is_told_whose_driver_it_is_and_costs_nobody_a_frame() {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    stage.write_mask("left.png", (752, 480), 10);
    stage.write_mask("left.candidate.png", (752, 480), 11);
    let mut witness = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut witness);
    // As if another user had started the driver.
    let root_path = stage.settings().root_path;
    chown(&root_path, Some(NOBODY), Some(NOBODY))
        .expect("run the tests as root: a file must change its owner");
    let owned = |user: &Output| {
        let said = stderr(user);
        assert_eq!(user.status.code(), Some(5), "{said}");
        let words = [root_path.to_str().unwrap(), "belongs to user nobody", "sudo -u nobody"];
        words.iter().for_each(|word| assert!(said.contains(word), "{word}: {said}"));
    };
    for _ in 0..3 {
        for words in [
            &["watch", "left", "--frames", "5"][..],
            &["stats"],
            &["generate", "left"],
            &["run", "--duration", "5"],
        ] {
            owned(&stage.output(words));
            next_frame(&mut witness);
        }
    }
    owned(&stage.output(&["mask", "accept", "left"]));
    let frames = witness.frames();
    while witness.frames() < frames + 30 {
        next_frame(&mut witness);
    }
    assert_eq!((witness.lost(), witness.epochs()), (0, 1));
    assert!(stderr(&driver.stop()).contains(" 0 lost"));
}

#[test]
fn a_limit_of_open_files_or_of_address_space_is_told() {
    let stage = stage();
    for (limit, words) in [
        ("-n 6", "ulimit -n"),
        ("-n 12", "ulimit -n"),
        ("-n 32", "at most 32 files may be open"),
        ("-n 40", "ulimit -n"),
        ("-v 100000", "ulimit -v"),
    ] {
        let config = stage.file("uvcam.toml");
        let shell = format!("ulimit {limit}; exec \"$0\" run --duration 5 --config \"$1\"");
        let output = Command::new("sh")
            .args([OsStr::new("-c"), shell.as_ref(), binary().as_ref(), config.as_ref()])
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(5), "{limit}: {said}");
        assert!(said.contains(words) && !said.contains("Internal"), "{limit}: {said}");
    }
    assert_eq!(shared(&stage, ".data"), [] as [PathBuf; 0]);
}

#[test]
fn files_that_are_removed_in_flight_are_made_anew() {
    let stage = stage();
    let mut witness = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut witness);
    let remove_all = |end: &str| {
        shared(&stage, end).iter().for_each(|file| _ = fs::remove_file(file));
    };
    let remove_folders = || {
        let folders = ["services", "nodes"].map(|folder| stage.settings().root_path.join(folder));
        folders.iter().for_each(|folder| fs::remove_dir_all(folder).unwrap());
    };
    let removals: [(&str, &dyn Fn()); 3] = [
        ("the page", &|| remove_all(".wake")),
        ("what logind removes", &|| remove_all("")),
        ("all", &|| {
            remove_all("");
            remove_folders();
        }),
    ];
    for (what, remove) in removals {
        let epochs = witness.epochs();
        remove();
        wait_until(what, || {
            next_frame(&mut witness);
            witness.epochs() > epochs
        });
        wait_until("the page", || !shared(&stage, ".wake").is_empty());
        // Who comes later finds all of it.
        let report = stage.watch(&["left", "--frames", "20"]).json();
        assert_eq!(report["lost"], 0, "{what}: {report}");
        let mut health = stage.health("left");
        health_where("a record", &mut health, |record| record.published > 0);
        let reload = stage.output(&["generate", "left", "--frames", "1"]);
        assert!(!stderr(&reload).contains("no driver"), "{what}: {}", stderr(&reload));
    }
    let said = stderr(&driver.stop());
    assert!(said.contains("files of its shared memory were removed"), "{said}");
}

#[test]
fn two_drivers_of_one_prefix_share_no_page() {
    let one = stage();
    let text = fs::read_to_string(one.file("uvcam.toml")).unwrap();
    let root_path = one.settings().root_path;
    let other = text.replacen(root_path.to_str().unwrap(), one.folder().join("other").to_str().unwrap(), 1);
    fs::write(one.file("other.toml"), other).unwrap();
    let driver = one.driver();
    let mut subscriber = one.subscriber("left");
    next_frame(&mut subscriber);
    let second = Process::start(
        Command::new(binary()).args(["run", "--config"]).arg(one.file("other.toml")).stdin(Stdio::null()),
    );
    let pages = || shared(&one, ".wake").len();
    wait_until("both pages", || {
        next_frame(&mut subscriber);
        pages() == 2
    });
    second.signal(Signal::TERM);
    assert!(second.finish().status.success());
    for _ in 0..10 {
        next_frame(&mut subscriber);
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 1));
    assert!(stderr(&driver.stop()).contains(" 0 lost"));
}

#[test]
fn doctor_and_driver_agree_on_the_memory_that_suffices() {
    let stage = Stage::new(&(simulated("left", "none", "") + &simulated("right", "none", "")));
    let config = Config::load(Some(&stage.file("uvcam.toml"))).unwrap();
    let needed = config.shared_memory_needed();
    let loans = |loans| config.ipc.settings.slots_needed(loans);
    assert!(
        loans(config.ipc.loans()) > loans(config.ipc.slots),
        "the driver holds more than what a camera fills"
    );
    let script = "mount -t tmpfs -o size=$1 tmpfs /dev/shm || exit 99
        $U doctor --config $C 2>&1; echo \"doctor $?\"
        $U run --config $C --duration 3 2> \"$2\" & driver=$!
        for camera in left right; do
            timeout 20 $U watch $camera --config $C --frames 5 --timeout 2 > \"$3\" 2>&1; echo \"$camera $?\"; done
        wait $driver; echo \"driver $?\"; cat \"$2\"";
    let (log, rest) = (stage.file("log"), stage.file("rest"));
    let judge = |bytes: u64| {
        let arguments = [&bytes.to_string(), log.to_str().unwrap(), rest.to_str().unwrap()];
        String::from_utf8_lossy(&in_namespace(&stage, script, &arguments).stdout).into_owned()
    };
    let enough = judge(needed.next_multiple_of(4096));
    assert!(!enough.contains("shared memory") && !enough.contains("/dev/shm"), "{enough}");
    for word in ["left 0", "right 0", "driver 0"] {
        assert!(enough.contains(word), "{word}: {enough}");
    }
    // What suffices for the frames that the cameras fill, but not for those that dead ones hold.
    let loans = config.ipc.slots;
    let frames = config.cameras.iter().map(|camera| camera.settings.frame_bytes());
    let few = judge(config.ipc.settings.shared_memory_of_all(frames, loans).next_multiple_of(4096));
    assert!(few.contains("fault: /dev/shm has room for") && few.contains("doctor 6"), "{few}");
    assert!(few.contains("driver 5") && few.contains("needs 5"), "{few}");
    // The advice is enough.
    let advised = few.split("size=").nth(1).unwrap().split(' ').next().unwrap();
    let megabytes: u64 = advised.trim_end_matches('M').parse().unwrap();
    let mended = judge(megabytes << 20);
    assert!(
        mended.contains("left 0") && mended.contains("right 0") && mended.contains("driver 0"),
        "{mended}"
    );
}

#[test]
fn waiting_for_a_driver_is_no_error() {
    let stage = stage();
    let watch = stage.watch(&["left", "--frames", "3"]);
    // The time in which nobody is there is what is tested.
    std::thread::sleep(Duration::from_millis(300));
    let _driver = stage.driver();
    assert_eq!(watch.json()["frames"], 3);
}
