//! What two cameras must not have in common.

use super::*;

/// Two cameras with these sources and masks, in a configuration of this folder.
fn two_in(folder: &Path, sources: [&str; 2], masks: [&str; 2]) -> Result<Config, ConfigError> {
    let table = |name: &str, source: &str, mask: &str| {
        let keys = "width = 752\nheight = 480\nfps = 60\nexposure_us = 1000\n";
        format!("[[camera]]\nname = \"{name}\"\nsource = {{ {source} }}\n{keys}mask = \"{mask}\"\n")
    };
    let text = table("left", sources[0], masks[0]) + &table("right", sources[1], masks[1]);
    Config::parse(&text, &folder.join("uvcam.toml"))
}

fn of_sources(one: &str, other: &str) -> Result<Config, ConfigError> {
    two_in(Path::new("/etc/uvcam"), [one, other], ["none", "none"])
}

fn of_masks(folder: &Path, one: &str, other: &str) -> Result<Config, ConfigError> {
    let [left, right] = ["L", "R"].map(|serial| format!("kind = \"simulated\", serial = \"{serial}\""));
    two_in(folder, [&left, &right], [one, other])
}

#[test]
fn one_device_is_one_camera() {
    for (one, other, key, shown) in [
        ("kind = \"aravis\", serial = \"00012\"", "kind = \"aravis\", serial = \"00012\"", "serial", "00012"),
        (
            "kind = \"aravis\", serial = \"00012\"",
            "kind = \"aravis\", serial = \" 00012\\t\"",
            "serial",
            "00012",
        ),
        (
            "kind = \"aravis\", serial = \"12\"",
            "kind = \"aravis\", serial = \"Basler-acA-12\"",
            "serial",
            "Basler-acA-12",
        ),
        (
            "kind = \"aravis\", serial = \"192.168.0.7\"",
            "kind = \"aravis\", serial = \"192.168.0.7\"",
            "serial",
            "192.168.0.7",
        ),
        ("kind = \"v4l2\", serial = \"42\"", "kind = \"v4l2\", serial = \"42\"", "serial", "42"),
        (
            "kind = \"v4l2\", path = \"/dev/video0\"",
            "kind = \"v4l2\", path = \"/dev/./x/../video0\"",
            "path",
            "/dev/./x/../video0",
        ),
    ] {
        let message = of_sources(one, other).unwrap_err().to_string();
        let expected = format!(
            "/etc/uvcam/uvcam.toml:11: {key}: found \"{shown}\" a second time, for \"right\" after \"left\"; allowed: a device of its own"
        );
        assert!(message.contains(&expected), "{message}\n{expected}");
    }
}

#[test]
fn a_link_leads_to_the_device_of_another_camera() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("video0"), "").unwrap();
    std::os::unix::fs::symlink("video0", folder.path().join("by-id")).unwrap();
    let of = |one, other| {
        two_in(
            folder.path(),
            [one, other]
                .map(|path| format!("kind = \"v4l2\", path = \"{path}\""))
                .each_ref()
                .map(String::as_str),
            ["none"; 2],
        )
    };
    let message = of("by-id", "video0").unwrap_err().to_string();
    assert!(message.contains("video0\" a second time, for \"right\" after \"left\""), "{message}");
    assert!(of("by-id", "video1").is_ok());
}

#[test]
fn devices_that_differ_are_accepted() {
    for (one, other) in [
        ("kind = \"aravis\", serial = \"00012\"", "kind = \"aravis\", serial = \"12\""),
        ("kind = \"aravis\", serial = \"12\"", "kind = \"aravis\", serial = \"GV-12\""),
        ("kind = \"aravis\", serial = \"12\"", "kind = \"v4l2\", serial = \"12\""),
        ("kind = \"v4l2\", path = \"/dev/video0\"", "kind = \"v4l2\", path = \"/dev/video2\""),
        ("kind = \"simulated\", serial = \"S\"", "kind = \"simulated\", serial = \"S\""),
        ("kind = \"replay\", path = \"frames\"", "kind = \"replay\", path = \"frames\""),
    ] {
        assert!(of_sources(one, other).is_ok(), "{one} {other}");
    }
}

#[test]
fn spaces_around_a_serial_are_left_out() {
    let config = parse(&CAMERA.replace("25003774", " 25003774\\n")).unwrap();
    assert_eq!(config.cameras[0].source.serial(), "25003774");
    assert!(refusal("25003774", "  ").contains("uvcam.toml:4: serial: found "));
}

#[test]
fn one_mask_file_is_of_one_camera() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("masks")).unwrap();
    std::fs::write(folder.join("masks/there.png"), "").unwrap();
    std::os::unix::fs::symlink("masks", folder.join("link")).unwrap();
    std::os::unix::fs::symlink("masks/there.png", folder.join("linked.png")).unwrap();
    std::fs::hard_link(folder.join("masks/there.png"), folder.join("hard.png")).unwrap();
    let absolute = folder.join("left.png").display().to_string();
    for (one, other) in [
        ("left.png", "left.png"),
        ("left.png", "./left.png"),
        ("left.png", "masks/../left.png"),
        ("left.png", "nowhere/../left.png"),
        ("left.png", absolute.as_str()),
        ("masks/left.png", "link/left.png"),
        ("masks/there.png", "linked.png"),
        ("masks/there.png", "hard.png"),
        ("{uav}.png", "uav.png"),
    ] {
        let message = of_masks(folder, one, other).unwrap_err().to_string();
        let expected =
            "for \"right\", which is the mask of \"left\"; allowed: a mask file of its own for each camera";
        assert!(
            message.contains("uvcam.toml:16: mask: found /") && message.contains(expected),
            "{one} {other}: {message}"
        );
    }
    let here = std::env::current_dir().unwrap().join("nowhere.png").display().to_string();
    assert!(
        of_masks(Path::new(""), "nowhere.png", &here).is_err(),
        "the configuration's own path is relative"
    );
    assert!(of_masks(folder, "{camera}.png", "{camera}.png").is_ok());
    assert!(of_masks(folder, "left.png", "masks/left.png").is_ok());
    assert!(of_masks(folder, "none", "none").is_ok());
}

#[test]
fn no_mask_is_among_the_files_of_another_camera_s() {
    let folder = tempfile::tempdir().unwrap();
    let store = crate::mask_files::MaskFiles::around(Path::new("left.png"));
    let [candidate, history] = [store.candidate(), store.history_folder().join("x.png")];
    for other in [&candidate, &history] {
        let other = other.to_str().unwrap();
        for (one, other) in [("left.png", other), (other, "left.png")] {
            let message = of_masks(folder.path(), one, other).unwrap_err().to_string();
            assert!(
                message.contains("for \"right\", whose candidate or history is among the files of \"left\""),
                "{one} {other}: {message}"
            );
        }
    }
    // The files around a link are taken, and those around what it leads to.
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    std::fs::write(folder.path().join("masks/target.png"), "").unwrap();
    std::os::unix::fs::symlink("masks/target.png", folder.path().join("link.png")).unwrap();
    for other in
        ["link.png", "masks/target.png"].map(|mask| crate::mask_files::MaskFiles::around(Path::new(mask)))
    {
        assert!(of_masks(folder.path(), "link.png", other.candidate().to_str().unwrap()).is_err());
    }
    // Two names share a candidate where the store makes one file of them.
    let share = |one: &str, other: &str| {
        let [one, other] =
            [one, other].map(|name| crate::mask_files::MaskFiles::around(Path::new(name)).candidate());
        one == other
    };
    assert_eq!(of_masks(folder.path(), "left.a", "left.b").is_err(), share("left.a", "left.b"));
}

#[test]
fn a_mask_that_no_key_names_has_its_place_at_the_name() {
    let other = CAMERA
        .replace("\"left\"", "\"right\"")
        .replace("25003774", "2")
        .replace("mask = \"masks/left.png\"", "");
    let text = CAMERA.replace("masks/left.png", "uav_2.png") + &other;
    let message = parse(&text).unwrap_err().to_string();
    assert!(message.contains("uvcam.toml:12: mask: found /etc/uvcam/uav_2.png for \"right\""), "{message}");
}
