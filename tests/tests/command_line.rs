//! What a person or a script sees of the commands.
#![allow(clippy::unwrap_used)]

use image::{GrayImage, Luma};
use serde_json::Value;
use uvcam_tests::{Stage, simulated, stderr};

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stderr(output)))
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn the_printed_configuration_can_be_run() {
    let stage = Stage::new("");
    let config = stage.output(&["config"]);
    assert!(config.status.success());
    let text = String::from_utf8(config.stdout).unwrap();
    let ipc =
        format!("prefix = \"{}\"\nroot_path = {:?}", stage.settings().prefix, stage.settings().root_path);
    let text = text.replace("prefix = \"uvcam_\"", &ipc).replace("root_path = \"/tmp/uvcam\"", "");
    std::fs::write(stage.file("uvcam.toml"), text).unwrap();
    let output = stage.output(&["run", "--duration", "1"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(output.stdout.is_empty(), "status belongs to stderr");
}

#[test]
fn watch_reports_the_documented_keys() {
    let stage = Stage::new(&simulated("left", "mask.png", ""));
    let mask = stage.write_mask("mask.png", (752, 480), 40);
    let _driver = stage.driver();
    let mask_file = stage.file("mask.png").to_string_lossy().into_owned();
    let report = stage.watch(&["left", "--frames", "60", "--mask", &mask_file]).json();
    assert_eq!(
        keys(&report),
        [
            "camera",
            "epochs",
            "fps",
            "frames",
            "height",
            "latency_us",
            "lost",
            "mask_id",
            "mask_mode",
            "masked_nonzero",
            "width"
        ]
    );
    assert_eq!(keys(&report["latency_us"]), ["max", "p50", "p90", "p99", "p999"]);
    assert_eq!((report["width"].as_u64(), report["height"].as_u64()), (Some(752), Some(480)));
    assert_eq!(report["mask_id"], mask.id().to_string());
    assert_eq!(report["mask_mode"], "blank");
    assert!((report["fps"].as_f64().unwrap() - 60.0).abs() < 3.0, "{report}");
    let latency = |key: &str| report["latency_us"][key].as_f64().unwrap();
    assert!(0.0 < latency("p50") && latency("p50") <= latency("p99") && latency("p99") <= latency("max"));
}

#[test]
fn watch_finds_pixels_that_its_mask_does_not_allow() {
    let stage = Stage::new(&simulated("left", "none", ""));
    stage.write_mask("mask.png", (752, 480), 40);
    let _driver = stage.driver();
    let mask_file = stage.file("mask.png").to_string_lossy().into_owned();
    let output = stage.watch(&["left", "--frames", "5", "--mask", &mask_file]).finish();
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(json(&output)["masked_nonzero"].as_u64().unwrap() > 0);
    assert_eq!(json(&output)["mask_id"], Value::Null);
}

#[test]
fn watch_saves_what_it_received() {
    let stage = Stage::new(&simulated("left", "mask.png", ", still = true"));
    let mask = stage.write_mask("mask.png", (752, 480), 100);
    let _driver = stage.driver();
    let folder = stage.file("saved");
    stage.watch(&["left", "--frames", "5", "--save", &folder.to_string_lossy()]).json();
    let pictures: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(pictures.len(), 5, "{pictures:?}");
    let picture = image::open(&pictures[0]).unwrap().into_luma8();
    assert_eq!(picture.dimensions(), (752, 480));
    assert!(picture.enumerate_pixels().all(|(x, y, pixel)| !mask.is_masked(x, y) || pixel.0 == [0]));
    assert!(picture.pixels().any(|pixel| pixel.0 != [0]));
}

#[test]
fn watch_says_when_nobody_publishes() {
    let stage = Stage::new(&simulated("left", "none", ""));
    let output = stage.output(&["watch", "left", "--timeout", "3", "--json"]);
    assert_eq!(output.status.code(), Some(5));
    assert!(stderr(&output).contains("is `uvcam run` running"), "{}", stderr(&output));
    assert_eq!(json(&output)["frames"], 0);
}

#[test]
fn mask_check_tells_what_can_fly() {
    let stage = Stage::new("");
    let check = |picture: GrayImage, size: &str| {
        picture.save(stage.file("mask.png")).unwrap();
        let file = stage.file("mask.png").to_string_lossy().into_owned();
        let output = stage.output(&["mask", "check", &file, "--size", size, "--json"]);
        (output.status.code(), json(&output))
    };
    let mut mask = GrayImage::from_pixel(64, 48, Luma([255]));
    for y in 10..30 {
        for x in 20..50 {
            mask.put_pixel(x, y, Luma([0]));
        }
    }
    let (code, report) = check(mask.clone(), "64x48");
    assert_eq!(code, Some(0), "{report}");
    assert_eq!(
        keys(&report),
        ["grey_px", "height", "mask_id", "masked_px", "parts", "problems", "runs", "width"]
    );
    assert_eq!((report["masked_px"].as_u64(), report["runs"].as_u64()), (Some(600), Some(20)));
    assert_eq!(report["parts"].as_array().unwrap().len(), 1);
    assert_eq!(report["problems"].as_array().unwrap().len(), 0);

    assert_eq!(check(mask.clone(), "48x64").0, Some(3));
    let (code, white) = check(GrayImage::from_pixel(64, 48, Luma([255])), "64x48");
    assert_eq!((code, white["problems"].as_array().unwrap().len()), (Some(0), 1), "{white}");
    mask.put_pixel(0, 0, Luma([77]));
    let (code, grey) = check(mask.clone(), "64x48");
    assert_eq!((code, grey["grey_px"].as_u64()), (Some(3), Some(1)), "{grey}");

    // An islet is a warning, and `repair` mends both at once.
    mask.put_pixel(30, 20, Luma([255]));
    mask.save(stage.file("mask.png")).unwrap();
    let [from, to] = ["mask.png", "repaired.png"].map(|name| stage.file(name).to_string_lossy().into_owned());
    let output = stage.output(&["mask", "repair", &from, &to]);
    assert_eq!(output.status.code(), Some(3), "grey levels are not guessed: {}", stderr(&output));
    assert!(stage.output(&["mask", "repair", "--threshold", "128", &from, &to]).status.success());
    let output = stage.output(&["mask", "check", &to, "--json"]);
    assert_eq!((output.status.code(), json(&output)["masked_px"].as_u64()), (Some(0), Some(601)));
}

#[test]
fn mask_apply_blanks_a_picture() {
    let stage = Stage::new("");
    let mask = stage.write_mask("mask.png", (64, 48), 8);
    GrayImage::from_pixel(64, 48, Luma([99])).save(stage.file("in.png")).unwrap();
    let [mask_file, input, output] =
        ["mask.png", "in.png", "out.png"].map(|name| stage.file(name).to_string_lossy().into_owned());
    assert!(stage.output(&["mask", "apply", "--mask", &mask_file, &input, &output]).status.success());
    let picture = image::open(stage.file("out.png")).unwrap().into_luma8();
    assert!(
        picture
            .enumerate_pixels()
            .all(|(x, y, pixel)| pixel.0 == [if mask.is_masked(x, y) { 0 } else { 99 }])
    );

    GrayImage::new(48, 64).save(stage.file("in.png")).unwrap();
    let refused = stage.output(&["mask", "apply", "--mask", &mask_file, &input, &output]);
    assert_eq!(refused.status.code(), Some(3), "{}", stderr(&refused));
}

#[test]
fn wrong_words_and_wrong_files_have_their_code() {
    let stage = Stage::new("[[camera]]\nname = \"left\"\nfpss = 3\n");
    let output = stage.output(&["run"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("uvcam.toml:6: fpss: found an unknown key (did you mean \"fps\"?)"),
        "{}",
        stderr(&output)
    );
    assert_eq!(stage.output(&["fly"]).status.code(), Some(2));
    assert_eq!(stage.output(&["mask", "check", "x.png", "--size", "big"]).status.code(), Some(2));
}

#[test]
fn list_prints_json_and_a_table() {
    let stage = Stage::new("");
    let output = stage.output(&["list", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(json(&output).is_array());
    assert!(stage.output(&["list"]).status.success());
}
