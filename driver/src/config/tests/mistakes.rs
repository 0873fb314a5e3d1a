//! What a crew writes instead of TOML, or instead of our keys and values, and what it is told to write.

use super::*;

#[test]
fn numbers_that_are_none_in_toml() {
    check(&[
        ("= 1000", "= 1000,0", "uvcam.toml:8: exposure_us: found 1000,0; write a point: 1000.0"),
        ("= 1000", "= 1,000", "exposure_us: found 1,000; write a point, 1.000, or no comma, 1000"),
        ("= 1000", "= auto", "exposure_us: found auto; write a number: all automatics are switched off"),
        ("= 1000", "= \"auto\"", "allowed: a number; write a number: all automatics are switched off"),
        ("= 1000", "= 01000", "exposure_us: found 01000; write it without zeros in front: 1000"),
        ("= 1000", "= 1000 us", "exposure_us: found 1000 us; write the number alone, in microseconds"),
        ("= 59.9", "= 60fps", "fps: found 60fps; write the number alone, in frames a second"),
        ("= 752", "= 752 px # wide", "uvcam.toml:5: width: found 752 px; write the number alone, in pixels"),
        ("= 59.9", "= .5", "fps: found .5; write digits on both sides of the point: 0.5"),
        ("= 59.9", "= 60.", "fps: found 60.; write digits on both sides of the point: 60.0"),
        ("= 1000", "= 10 000", "exposure_us: found 10 000; write the digits without gaps: 10000"),
        ("= 59.9", "= −3", "fps: found −3; write it: -3"),
        ("= 59.9", "= 60,", "fps: found 60,; write nothing behind it: 60"),
        ("= 59.9", "= 60;", "fps: found 60;; write nothing behind it: 60"),
        ("= 59.9", "= +-3", "uvcam.toml:7: not TOML: fps = +-3: redundant numeric sign"),
        (
            "kind = \"aravis\"",
            "kind = \"simulated\", readout_us = 97,5",
            "uvcam.toml:4: readout_us: found 97,5; write a point: 97.5",
        ),
    ]);
}

#[test]
fn numbers_that_are_none_of_ours() {
    check(&[
        ("= 59.9", "= \"60\"", "fps: found string \"60\"; allowed: a number; write it without quotes: 60"),
        ("= 1000", "= \"1000,5\"", "allowed: a number; write a point without quotes: 1000.5"),
        ("= 1000", "= \"1000 us\"", "a number; write the number alone without quotes, in microseconds"),
        ("= 752", "= 752.0", "a whole number, not negative; write it without a fraction: 752"),
        ("= 752", "= 7.5e2", "a whole number, not negative; write it without an exponent: 750"),
        ("= 752", "= 9999999999", "uvcam.toml:5: width: found 9999999999; allowed: 1 to 16384 px"),
        ("= 752", "= 99999999999999999999", "width: found integer 99999999999999999999; allowed: a smaller"),
        (
            "= 59.9",
            "= 99999999999999999999",
            "fps: found integer 99999999999999999999; allowed: a number nearer",
        ),
        ("= 59.9", "= 1e400", "uvcam.toml:7: fps: found 1e400; allowed: a number nearer to zero"),
        ("= 59.9", "= inf", "fps: found inf; allowed: 0.1 to 10000 frames a second"),
        ("= 59.9", "= 1970-01-01", "fps: found 1970-01-01; allowed: a number"),
        ("= 59.9", "= true", "fps: found boolean true; allowed: a number"),
        (
            "mask =",
            "realtime = { cpus = 3 }\nmask =",
            "cpus: found integer 3; allowed: a list; write it in brackets: [3]",
        ),
    ]);
}

#[test]
fn texts_that_are_none() {
    check(&[
        (
            "\"25003774\"",
            "00253774",
            "uvcam.toml:4: serial: found 00253774; write it in quotes: \"00253774\"",
        ),
        (
            "\"25003774\"",
            "25003774",
            "serial: found integer 25003774; allowed: a text; write it in quotes: \"25003774\"",
        ),
        (
            "\"25003774\"",
            "1e5",
            "serial: found floating point 100000.0; allowed: a text; write it in quotes: \"1e5\"",
        ),
        ("\"25003774\"", "A1B2", "serial: found A1B2; write it in quotes: \"A1B2\""),
        ("\"left\"", "\"left\";", "name: found \"left\";; write nothing behind it: \"left\""),
        (
            "\"left\"",
            "\"levá\"",
            "name: found levá; allowed: 1 to 64 letters, digits, \"_\" or \"-\" (ASCII)",
        ),
        ("\"left\"", "left", "uvcam.toml:3: name: found left; write it in quotes: \"left\""),
        ("\"left\"", "“left”", "name: found “left”; write it in straight quotes: \"left\""),
        ("\"left\"", "\"left", "name: found \"left; write it in quotes: \"left\""),
        ("\"masks/left.png\"", "none", "mask: found none; write it in quotes: \"none\""),
        (
            "\"masks/left.png\"",
            "false",
            "mask: found boolean false; allowed: a text; write \"none\" to fly without a mask",
        ),
        (
            "\"masks/left.png\"",
            "\"C:\\masks\"",
            "write it in single quotes, where \\ is a plain character: 'C:\\masks'",
        ),
        ("kind = \"aravis\"", "kind = \"simulated\", still = True", "still: found True; write true"),
        ("kind = \"aravis\"", "kind = \"simulated\", still = \"yes\"", "allowed: true or false; write true"),
    ]);
}

#[test]
fn lines_that_are_none() {
    check(&[
        (
            "fps = 59.9",
            "fps: 59.9",
            "uvcam.toml:7: fps: found fps: 59.9; write = between key and value: fps = 59.9",
        ),
        ("fps = 59.9", "\"fps\": 59.9", "write = between key and value: fps = 59.9"),
        ("fps = 59.9", "fps := 59.9", "write = between key and value: fps = 59.9"),
        ("fps = 59.9", "fps 59.9", "write = between key and value: fps = 59.9"),
        ("fps = 59.9", "fps =", "fps: found nothing; write a value behind ="),
        ("fps = 59.9", "// fast", "uvcam.toml:7: line: found // fast; write # before a comment"),
        ("fps = 59.9", "fps = 59.9 // fast", "fps: found 59.9 // fast; write # before a comment"),
        ("fps = 59.9", "fps = 60 gain_db = 3", "fps: found 60 gain_db = 3; write one key a line, with one ="),
        (
            "fps = 59.9",
            "fps = 60\u{a0}",
            "fps: found 60\u{a0}; write a plain space instead of the character U+00A0",
        ),
        ("[[camera]]", "[[camera]", "uvcam.toml:2: camera: found [[camera]; write [[camera]]"),
        (" }", "", "uvcam.toml:5: width: found 752; write a comma between keys, and } behind the last"),
        (", serial", " serial", "write a comma between keys"),
        (
            "fps = 59.9",
            "realtime = { cpus = [1, 2",
            "write a comma between the elements of a list, and ] behind the last",
        ),
    ]);
    let message = parse("source = { kind = 1,").unwrap_err().to_string();
    assert!(message.contains("write } behind the last key"), "{message}");
    let message = parse("[[camera]]\rname = 1\r").unwrap_err().to_string();
    assert!(message.contains("save it with the line ends of Unix (LF)"), "{message}");
}

#[test]
fn cameras_in_single_brackets() {
    for text in [CAMERA.replace("[[camera]]", "[camera]"), CAMERA.replace("[[camera]]", "[camera.left]")] {
        let message = parse(&text).unwrap_err().to_string();
        assert!(
            message
                .contains("uvcam.toml:2: camera: found a single table; write [[camera]] above each camera"),
            "{message}"
        );
    }
    let single = CAMERA.replace("[[camera]]", "[camera]");
    for text in [format!("{single}{single}"), format!("{CAMERA}{single}"), format!("{single}{CAMERA}")] {
        let message = parse(&text).unwrap_err().to_string();
        assert!(message.contains(": camera: found") && message.contains("write [[camera]]"), "{message}");
    }
    let message = parse(&CAMERA.replace("[[camera]]", "[[cameras]]")).unwrap_err().to_string();
    assert!(message.contains("cameras: found an unknown key (did you mean \"camera\"?)"), "{message}");
}

#[test]
fn headings_and_keys_without_a_name() {
    check(&[
        ("[[camera]]", "[", "uvcam.toml:2: not TOML: [; write a name between the brackets"),
        ("[[camera]]", "[[]", "uvcam.toml:2: not TOML: [[]; write a name between the brackets"),
        ("exposure_us = 1000", "= 1000", "uvcam.toml:8: not TOML: "),
        ("exposure_us = 1000", "\"\" = 1000", "uvcam.toml:8: \"\": found an unknown key"),
        ("exposure_us = 1000", ": exposure = true", "uvcam.toml:8: not TOML: : exposure = true; "),
    ]);
}

#[test]
fn keys_at_the_wrong_place() {
    check(&[
        (
            "[[camera]]",
            "",
            "uvcam.toml:8: exposure_us: found a key of [[camera]] at the top of the file; write it below the line [[camera]]",
        ),
        ("[[camera]]", "[ipc]", "a key of [[camera]] in [ipc]; write it below the line [[camera]]"),
        (
            "mask =",
            "[camera.generate]\nmask =",
            "uvcam.toml:10: mask: found a key of [[camera]] in [camera.generate]; write it below [[camera]], above [camera.generate]",
        ),
        (
            "mask =",
            "serial = \"1\"\nmask =",
            "serial: found a key of source in [[camera]]; write it in the braces of source",
        ),
        (
            "mask =",
            "[generate]\nsigma = 1\n#",
            "generate: found a key of [[camera]] at the top of the file; write [camera.generate]",
        ),
        (
            "mask =",
            "fps = 60\nmask =",
            "uvcam.toml:9: fps: found the key a second time; allowed: each key once",
        ),
    ]);
}

#[test]
fn lists_and_tables_in_place_of_each_other() {
    let source = "{ kind = \"aravis\", serial = \"25003774\" }";
    check(&[
        ("[[camera]]", "[[ipc]]\n[[camera]]", "uvcam.toml:2: ipc: found a list; write [ipc]"),
        (source, &format!("[{source}]"), "uvcam.toml:4: source: found a list; write source = { ... }"),
        (
            source,
            "\"/dev/video0\"",
            "source: found string \"/dev/video0\"; allowed: a table; write { kind = ",
        ),
        (source, &format!("{source},"), "},; write nothing behind the last bracket"),
        ("mask =", "[[camera.generate]]\n#", "uvcam.toml:9: generate: found a list; write [camera.generate]"),
        ("mask =", "realtime = []\n#", "realtime: found a list; write [camera.realtime]"),
        (
            "mask =",
            "generate.ignore_polygons = [[[1, 2, 3]]]\n#",
            "ignore_polygons: found 3 numbers; allowed: [x, y] in pixels",
        ),
        (
            "mask =",
            "generate.ignore_polygons = [[1, 2]]\n#",
            "ignore_polygons: found integer 1; allowed: a list",
        ),
    ]);
    let message = parse("camera = [1]").unwrap_err().to_string();
    assert!(
        message.ends_with(":1: camera: found a list without tables; write [[camera]] above each camera"),
        "{message}"
    );
}

#[test]
fn keys_and_words_of_others() {
    check(&[
        ("fps =", "frame_rate =", "frame_rate: found an unknown key (did you mean \"fps\"?)"),
        ("fps =", "FPS =", "FPS: found an unknown key (did you mean \"fps\"?)"),
        (
            "kind =",
            "type =",
            "type: found an unknown key (did you mean \"kind\"?); allowed: kind = \"aravis\"",
        ),
        (
            "kind = \"aravis\", serial",
            "kind = \"v4l2\", device",
            "uvcam.toml:4: device: found an unknown key (did you mean \"path\"?); allowed: path, serial, memory, gain_step_db, \
             fixed_exposure_us in a source of kind \"v4l2\"",
        ),
        (
            ", serial",
            ", path = \"/dev/video0\", serial",
            "path: found a value; allowed: no such key in a source of kind \"aravis\" but serial; it is one of kind \"replay\" or \
             \"v4l2\"",
        ),
        ("\"aravis\"", "\"V4L2\"", "kind: found \"V4L2\" (did you mean \"v4l2\"?)"),
        ("\"aravis\"", "\"uvc\", device = 1", "kind: found \"uvc\" (did you mean \"v4l2\"?)"),
        (
            "mask =",
            "pixel_format = \"mono8\"\nmask =",
            "pixel_format: found \"mono8\" (did you mean \"Mono8\"?)",
        ),
        ("mask =", "mask_mode = \"atach\"\nmask =", "mask_mode: found \"atach\" (did you mean \"attach\"?)"),
        ("mask =", "source.device = 1\nmask =", "not TOML"),
    ]);
}

#[test]
fn keys_of_each_table_are_those_that_are_read() {
    for (heading, keys) in document::tables() {
        let text = match heading {
            keys::TOP => "nothing = 1\n".to_owned() + CAMERA,
            "source" => CAMERA.replace("kind = \"aravis\", serial", "nothing"),
            "[[camera]]" => CAMERA.to_owned() + "nothing = 1\n",
            "[ipc]" => format!("[ipc]\nnothing = 1\n{CAMERA}"),
            heading => format!("{CAMERA}{heading}\nnothing = 1\n"),
        };
        let message = parse(&text).unwrap_err().to_string();
        assert!(message.ends_with(&format!("; allowed: {}", keys.join(", "))), "{heading}: {message}");
    }
}

#[test]
fn a_message_shows_no_control_characters_and_no_more_than_a_line() {
    let long = "x".repeat(10_000);
    for text in [
        "uav = \"\\u001b[2J\"",
        "uav = \u{1b}[2J",
        &format!("uav = {long}"),
        &format!("{long} = 1"),
        &format!("{long} ="),
    ] {
        let message = parse(text).unwrap_err().to_string();
        assert!(!message.contains(char::is_control) && message.len() < 300, "{message:?}");
    }
}
