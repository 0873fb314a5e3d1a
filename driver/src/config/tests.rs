use std::path::Path;

use proptest::prelude::*;

use super::*;

mod file;
mod mistakes;
mod paths;
mod shared;

const CAMERA: &str = r#"
[[camera]]
name = "left"
source = { kind = "aravis", serial = "25003774" }
width = 752
height = 480
fps = 59.9
exposure_us = 1000
mask = "masks/left.png"
"#;

fn parse(text: &str) -> Result<Config, ConfigError> {
    Config::parse(text, Path::new("/etc/uvcam/uvcam.toml"))
}

/// The message for the camera above with one line changed.
fn refusal(line: &str, instead: &str) -> String {
    assert!(CAMERA.contains(line), "{line}");
    parse(&CAMERA.replace(line, instead)).unwrap_err().to_string()
}

/// The message for the camera with one line changed must hold what is expected: line, its replacement, and a part of the message.
fn check(cases: &[(&str, &str, &str)]) {
    for (line, instead, expected) in cases {
        let message = refusal(line, instead);
        assert!(message.contains(expected), "{instead}\n  gives    {message}\n  expected {expected}");
    }
}

#[test]
fn the_default_is_valid_and_says_what_the_code_does_without_it() {
    let config = Config::load(None).unwrap();
    let bare = parse(CAMERA).unwrap();
    assert_eq!((config.ipc, config.process_per_camera), (bare.ipc, bare.process_per_camera));
    assert_eq!(config.process_memory_bytes, bare.process_memory_bytes);
    assert_eq!(config.cameras.len(), 1);
    let (shown, plain) = (&config.cameras[0].settings, &bare.cameras[0].settings);
    assert_eq!(config.cameras[0].realtime, bare.cameras[0].realtime);
    assert_eq!(config.cameras[0].mask_mode, bare.cameras[0].mask_mode);
    assert_eq!(
        (shown.offset_x, shown.offset_y, shown.pixel_format, shown.gain_db),
        (plain.offset_x, plain.offset_y, plain.pixel_format, plain.gain_db)
    );
}

#[test]
fn relative_paths_start_at_the_folder_of_the_file() {
    let config = parse(CAMERA).unwrap();
    assert_eq!(config.cameras[0].mask, MaskChoice::File("/etc/uvcam/masks/left.png".into()));
    let text = CAMERA.replace("masks/left.png", "/masks/left.png");
    assert_eq!(parse(&text).unwrap().cameras[0].mask, MaskChoice::File("/masks/left.png".into()));
}

#[test]
fn only_the_word_none_flies_unmasked() {
    assert_eq!(parse(&CAMERA.replace("masks/left.png", "none")).unwrap().cameras[0].mask, MaskChoice::None);
    let unnamed = CAMERA.replace("mask = \"masks/left.png\"", "");
    assert_eq!(
        parse(&unnamed).unwrap().cameras[0].mask,
        MaskChoice::File("/etc/uvcam/uav_25003774.png".into())
    );
    assert!(
        refusal("masks/left.png", "").contains("mask: found an empty text; allowed: a PNG file, or \"none\"")
    );
}

#[test]
fn a_refusal_names_file_line_key_value_and_what_is_allowed() {
    check(&[
        ("fps = 59.9", "fps = -3", "uvcam.toml:7: fps: found -3; allowed: 0.1 to 10000 frames a second"),
        ("fps = 59.9", "fps = nan", "uvcam.toml:7: fps: found NaN"),
        ("fps = 59.9", "fps = \"fast\"", "uvcam.toml:7: fps: found string \"fast\"; allowed: a number"),
        ("width = 752", "width = 0", "uvcam.toml:5: width: found 0; allowed: 1 to 16384 px"),
        (
            "width = 752",
            "width = -1",
            "uvcam.toml:5: width: found integer -1; allowed: a whole number, not negative",
        ),
        ("exposure_us = 1000", "exposure_us = 0", "uvcam.toml:8: exposure_us: found 0"),
        (
            "exposure_us = 1000",
            "exposre_us = 1000",
            "exposre_us: found an unknown key (did you mean \"exposure_us\"?)",
        ),
        ("name = \"left\"", "name = \"le ft\"", "uvcam.toml:3: name: found le ft; allowed: 1 to 64 letters"),
        ("kind = \"aravis\"", "kind = \"usb\"", "uvcam.toml:4: kind: found \"usb\"; allowed: \"aravis\""),
        (", serial = \"25003774\"", "", "uvcam.toml:4: serial: found nothing"),
        (
            ", serial",
            ", still = true, serial",
            "still: found a value; allowed: no such key in a source of kind \"aravis\"",
        ),
        (
            "mask =",
            "mask_mode = \"none\"\nmask =",
            "mask_mode: found \"none\"; allowed: \"blank\" or \"attach\"",
        ),
        (
            "mask = \"masks/left.png\"",
            "mask_mode = \"attach\"\nmask = \"none\"",
            "uvcam.toml:9: mask_mode: found \"attach\"; allowed: \"blank\" where mask is \"none\": there is none to attach",
        ),
        ("mask =", "pixel_format = \"RGB8\"\nmask =", "pixel_format: found \"RGB8\"; allowed: Mono8, Mono10"),
        (
            "[[camera]]",
            "[ipc]\nbuffer = 0\n[[camera]]",
            "uvcam.toml:3: buffer: found 0; allowed: 1 to 256 frames",
        ),
        (
            "[[camera]]",
            "[ipc]\nroot_path = \"run\"\n[[camera]]",
            "root_path: found run; allowed: an absolute path",
        ),
        ("fps = 59.9", "fps = = 3", "uvcam.toml:7: not TOML"),
        (
            "mask =",
            "realtime = { priority = 100 }\nmask =",
            "uvcam.toml:9: priority: found 100; allowed: 0 to 99",
        ),
        (
            "mask =",
            "realtime = { cpus = [1, 4096] }\nmask =",
            "cpus: found 4096; allowed: cores from 0 to 1023",
        ),
    ]);
}

#[test]
fn no_camera_and_the_same_name_twice_are_refused() {
    assert!(parse("").unwrap_err().to_string().contains("camera: found no [[camera]] table"));
    let message = parse(&format!("{CAMERA}{CAMERA}")).unwrap_err().to_string();
    assert!(message.contains("uvcam.toml:12: name: found \"left\" a second time"), "{message}");
}

#[test]
fn the_faults_of_a_simulated_camera_come_in_the_order_of_frames() {
    let text = CAMERA.replace(
        "kind = \"aravis\"",
        "kind = \"simulated\", faults = [{ kind = \"unplug\", at_frame = 9, seconds = 2 }, { kind = \"lost\", at_frame = 4 }]",
    );
    let Source::Simulated(simulated) = &parse(&text).unwrap().cameras[0].source else {
        panic!("another source")
    };
    assert_eq!(
        simulated.faults,
        [
            Fault { at_frame: 4, kind: FaultKind::Lost { count: 1 } },
            Fault { at_frame: 9, kind: FaultKind::Unplug { seconds: 2.0 } },
        ]
    );
}

#[test]
fn a_camera_of_the_kernel_is_named_by_path_or_serial() {
    let parse_source = |keys: &str| {
        let source = "source = { kind = \"aravis\", serial = \"25003774\" }";
        assert!(CAMERA.contains(source));
        parse(&CAMERA.replace(source, &format!("source = {{ kind = \"v4l2\"{keys} }}")))
    };
    let bare = V4l2 {
        device: V4l2Device::Path("/dev/video0".into()),
        memory: None,
        gain_step_db: None,
        fixed_exposure_us: None,
    };
    let config = parse_source(", path = \"/dev/video0\"").unwrap();
    assert_eq!(config.cameras[0].source, Source::V4l2(bare.clone()));
    assert_eq!(config.cameras[0].source.serial(), "video0");
    let config =
        parse_source(", serial = \"42\", memory = \"mmap\", gain_step_db = 0.1, fixed_exposure_us = 1000")
            .unwrap();
    let all = V4l2 {
        device: V4l2Device::Serial("42".into()),
        memory: Some(V4l2Memory::Mapped),
        gain_step_db: Some(0.1),
        fixed_exposure_us: Some(1000.0),
    };
    assert_eq!(config.cameras[0].source, Source::V4l2(all));
    for (keys, expected) in [
        ("", "path or serial: found nothing"),
        (
            ", path = \"/dev/video0\", serial = \"42\"",
            "source: found both path and serial; allowed: one of them",
        ),
        (", serial = \"42\", memory = \"read\"", "memory: found \"read\"; allowed: \"userptr\" or \"mmap\""),
        (", serial = \"42\", gain_step_db = 0", "gain_step_db: found 0; allowed: 0.001 to 20 decibels"),
        (", serial = \"\"", "serial: found an empty text"),
        (
            ", serial = \"42\", still = true",
            "still: found a value; allowed: no such key in a source of kind \"v4l2\"",
        ),
    ] {
        let message = parse_source(keys).unwrap_err().to_string();
        assert!(message.contains(expected), "{keys}\n  gives    {message}\n  expected {expected}");
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let error = Config::load(Some(Path::new("/nowhere/uvcam.toml"))).unwrap_err();
    let message = crate::causes::with_causes(&error);
    assert!(
        message.starts_with("/nowhere/uvcam.toml: cannot be read;") && message.contains("No such file"),
        "{message}"
    );
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "\\PC*") {
        let _ = parse(&text);
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in any::<Vec<u8>>()) {
        let _ = Config::from_bytes(&bytes, Path::new("uvcam.toml"));
    }

    #[test]
    fn no_mistake_makes_the_reader_panic(
        line in 0..CAMERA.lines().count(),
        words in prop::collection::vec(prop::sample::select(vec![
            "=", ",", "{", "}", "[", "]", "\"", "'", "#", "//", ":", ";", "0", "00", "1", ".", "-", "−", "~", "$", "€", "\u{a0}", "\r",
            "\t", " ", "auto", "none", "true", "inf", "e9", "us", "serial", "mask", "camera", "\\", "“",
        ]), 0..12),
    ) {
        let lines: Vec<&str> = CAMERA.lines().collect();
        let (before, after) = lines.split_at(line);
        let text = format!("{}\n{}\n{}", before.join("\n"), words.concat(), after.join("\n"));
        if let Err(error) = parse(&text) {
            let message = error.to_string();
            prop_assert!(message.starts_with("/etc/uvcam/uvcam.toml:") && !message.contains(char::is_control), "{message:?}");
        }
    }

    #[test]
    fn no_change_of_the_default_makes_the_reader_panic(at in 0..DEFAULT.len(), with in any::<[u8; 3]>()) {
        let mut bytes = DEFAULT.as_bytes().to_vec();
        let end = (at + with.len()).min(bytes.len());
        bytes.splice(at..end, with);
        let _ = parse(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn no_number_makes_the_reader_panic(number in any::<f64>(), key in prop::sample::select(vec!["fps", "exposure_us", "gain_db"])) {
        let _ = parse(&CAMERA.replace("fps = 59.9", &format!("{key} = {number:?}")));
    }
}

#[test]
fn each_camera_has_a_process_with_bounded_memory_unless_the_file_says_otherwise() {
    let read = |top: &str| parse(&format!("{top}{CAMERA}"));
    assert!(read("").unwrap().process_per_camera);
    assert!(!read("process_per_camera = false\n").unwrap().process_per_camera);
    let refused = read("process_per_camera = 0\n").unwrap_err().to_string();
    assert!(refused.contains("process_per_camera"), "{refused}");
    assert_eq!(read("process_memory_mb = 128\n").unwrap().process_memory_bytes, 128 << 20);
    let refused = read("process_memory_mb = 127\n").unwrap_err().to_string();
    assert!(refused.contains("process_memory_mb") && refused.contains("128 to 1048576 MB"), "{refused}");
}

#[test]
fn a_part_of_a_configuration_is_the_whole_but_for_the_other_cameras() {
    let text = CAMERA.to_owned() + &CAMERA.replace("left", "right").replace("25003774", "25003775");
    let config = Config::handed_over(text.as_bytes(), None).unwrap();
    let part = config.clone().with_only("right").unwrap();
    assert_eq!(part.cameras, config.cameras[1..]);
    assert_eq!((part.digest, &part.text, &part.ipc), (config.digest, &config.text, &config.ipc));
    assert_eq!(config.with_only("back"), None);
}
