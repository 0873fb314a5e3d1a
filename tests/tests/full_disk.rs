//! A disk that fills while a mask is stored.

#![allow(clippy::unwrap_used)]

use std::process::Command;

use uvcam_tests::{Stage, binary, namespace, simulated};

/// Mounts `$1` kB at `$2`, copies the mask in force there, generates, lists what is there, and unmounts it.
const SCRIPT: &str = "mount -t tmpfs -o size=\"$1k\" tmpfs \"$2\" && cp \"$3\" \"$2/left.png\" || exit 99
\"$4\" generate left --accept --replace --config \"$5\" >&2; echo \"exit code $?\"
ls -A \"$2\"; cmp \"$3\" \"$2/left.png\" && echo unchanged
umount \"$2\"";

/// What the script says, with a disk of this size.
fn generate_on_disk_of(kilobytes: u32) -> String {
    let stage =
        Stage::new(&(simulated("left", "disk/left.png", "") + "[camera.generate]\nignore = [\"::0:240\"]\n"));
    std::fs::create_dir(stage.file("disk")).unwrap();
    stage.write_mask("before.png", (752, 480), 10);
    let options = namespace::first_possible([
        vec!["--mount"],
        // Of root in a chroot, which has no mount of its own that could be made private: the script unmounts what it mounted.
        vec!["--mount", "--propagation", "unchanged"],
        vec!["--mount", "--map-root-user"],
    ]);
    let output = Command::new("unshare")
        .args(options)
        .args(["sh", "-c", SCRIPT, "sh", &kilobytes.to_string()])
        .args([stage.file("disk"), stage.file("before.png"), binary().into(), stage.file("uvcam.toml")])
        .output()
        .unwrap();
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert_ne!(output.status.code(), Some(99), "{text}");
    text
}

#[test]
fn the_mask_in_force_stays_whole_and_nothing_half_written_is_left() {
    // Room for none of the files, for the first picture, and for both pictures without the mask.
    let mut refused = 0;
    for kilobytes in [16, 64, 128, 256, 512] {
        let said = generate_on_disk_of(kilobytes);
        if said.contains("exit code 0") {
            break;
        }
        refused += 1;
        assert!(
            said.contains("exit code 7") && said.contains("No space left on device"),
            "{kilobytes} kB: {said}"
        );
        assert!(said.contains("\nleft.png\nunchanged\n"), "{kilobytes} kB: {said}");
    }
    assert!(refused >= 2, "the disks were too large to show anything");
}

#[test]
fn a_disk_with_room_takes_the_mask() {
    let said = generate_on_disk_of(4096);
    assert!(said.contains("exit code 0") && !said.contains("unchanged"), "{said}");
}
