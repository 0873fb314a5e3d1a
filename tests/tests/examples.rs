//! The examples of the consumer's crate, as they stand, on frames of the real driver.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::OnceLock;

use uvcam_masker::Mask;
use uvcam_tests::{Stage, binary, simulated};

/// A running example, and the lines that it says.
struct Example {
    child: Child,
    lines: std::io::Lines<BufReader<ChildStdout>>,
}

impl Example {
    /// Starts an example on the camera `left`; `words` come before the camera's name.
    fn start(stage: &Stage, name: &str, words: &[&str]) -> Self {
        let settings = stage.settings();
        let mut command = Command::new(folder().join(name));
        command.args(words).args(["left", &settings.prefix]).arg(&settings.root_path);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Example { child, lines }
    }

    fn line(&mut self) -> String {
        self.lines.next().unwrap().unwrap()
    }
}

impl Drop for Example {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Where the examples are. They are built here: cargo builds those of other packages only when asked.
fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let programs = binary().parent().unwrap();
        let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        build.args(["build", "--quiet", "--package", "uvcam-shm-ipc", "--examples", "--target-dir"]);
        build.arg(programs.parent().unwrap()).current_dir(env!("CARGO_MANIFEST_DIR"));
        if programs.ends_with("release") {
            build.arg("--release");
        }
        assert!(build.status().unwrap().success(), "the examples were not built");
        programs.join("examples")
    })
}

#[test]
fn each_is_short_enough_to_be_read_at_once() {
    let sources = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../shm_ipc/examples")).unwrap();
    let sources: Vec<_> = sources.map(|source| source.unwrap().path()).collect();
    assert!(sources.len() >= 4, "{sources:?}");
    for source in sources {
        let lines = std::fs::read_to_string(&source).unwrap().lines().count();
        assert!(lines <= 40, "{}: {lines} lines", source.display());
    }
}

#[test]
fn rate_and_loss_are_told_every_second() {
    let faults = ", faults = [{ kind = \"lost\", at_frame = 200, count = 3 }]";
    let stage = Stage::new(&simulated("left", "none", faults));
    let mut example = Example::start(&stage, "rate_and_loss", &[]);
    let _driver = stage.driver();
    let line = std::iter::from_fn(|| Some(example.line())).find(|line| !line.ends_with(" 0 lost")).unwrap();
    assert!(line.starts_with("left: ") && line.ends_with(" frames a second, 3 lost"), "{line}");
}

#[test]
fn a_saved_png_is_the_frame_as_it_was_sent() {
    for (format, depth) in [("Mono8", 8), ("Mono12", 16)] {
        let camera = simulated("left", "left.png", "") + &format!("pixel_format = \"{format}\"\n");
        let stage = Stage::new(&camera);
        let mask = stage.write_mask("left.png", (752, 480), 100);
        let file = stage.file("saved.png");
        let mut example = Example::start(&stage, "save_png", &[file.to_str().unwrap()]);
        let _driver = stage.driver();
        let line = example.line();
        assert!(line.contains("saved.png: 752x480, 0 lost before"), "{line}");
        let saved = image::open(&file).unwrap();
        assert_eq!(saved.color().bits_per_pixel(), depth);
        let saved = saved.to_luma16();
        let brightest = saved.enumerate_pixels().map(|(x, y, pixel)| (mask.is_masked(x, y), pixel.0[0]));
        let (masked, kept): (Vec<_>, Vec<_>) = brightest.partition(|(is_masked, _)| *is_masked);
        assert!(masked.iter().all(|(_, value)| *value == 0));
        assert!(kept.iter().any(|(_, value)| *value > 1000), "{format}");
    }
}

#[test]
fn the_mask_is_told_with_where_it_comes_from() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + "mask_mode = \"attach\"\n"));
    let mask = Mask::from_fn(752, 480, |_, y| y >= 470);
    mask.save(&stage.file("left.png"), &[("Method", "by hand".into())]).unwrap();
    let mut example = Example::start(&stage, "mask", &[]);
    let _driver = stage.driver();
    let expected = format!("left: mask {}, attached: 7520 px, {} px stay clear of it", mask.id(), 752 * 465);
    assert_eq!(example.line(), expected);
    assert_eq!(example.line(), r#"left: from {"Method":"by hand"}"#);
}

/// Where the simulated camera draws its markers, the upper left corner of 3 x 3 px, in a frame of 752 x 480 px.
fn drawn(frame_id: u64) -> Vec<(i64, i64)> {
    const CODES: [u16; 2] = [0b1110_0110_1010_0101, 0b1100_1011_0010_1101];
    let lit = (0..2).filter(|marker| CODES[*marker] >> (frame_id % 16) & 1 == 1);
    lit.map(|marker| {
        let angle = frame_id as f64 * 0.004 + marker as f64 * 2.0;
        (((0.5 + 0.35 * angle.sin()) * 752.0) as i64, ((0.25 + 0.15 * (1.7 * angle).cos()) * 480.0) as i64)
    })
    .collect()
}

/// Places of `one` that are more than 4 px away from all of `other`.
fn without(one: &[(i64, i64)], other: &[(i64, i64)]) -> Vec<(i64, i64)> {
    let near = |a: &(i64, i64), b: &(i64, i64)| (a.0 - b.0).abs() <= 4 && (a.1 - b.1).abs() <= 4;
    one.iter().filter(|place| !other.iter().any(|it| near(place, it))).copied().collect()
}

#[test]
fn markers_are_found_where_they_blink_and_none_on_the_airframe() {
    // Lit frames, of which the driver itself makes the mask.
    let stage =
        Stage::new(&simulated("left", "left.png", "").replace("exposure_us = 1000", "exposure_us = 5000"));
    let generated = stage.output(&["generate", "left", "--accept"]);
    assert!(generated.status.success(), "{}", uvcam_tests::stderr(&generated));
    let mask = Mask::load(&stage.file("left.png")).unwrap();
    assert!(mask.masked_px() > 10_000);
    let mut example = Example::start(&stage, "uvdar_markers", &[]);
    let _driver = stage.driver();
    let mut frames = BTreeMap::new();
    let mut seen = 0;
    while frames.len() < 30 {
        let line = example.line();
        let (id, markers) = line.split_once(": ").unwrap();
        let numbers: Vec<i64> =
            markers.split(|sign: char| !sign.is_ascii_digit()).filter_map(|it| it.parse().ok()).collect();
        let found: Vec<_> = numbers.chunks_exact(2).map(|place| (place[0], place[1])).collect();
        frames.insert(id.parse::<u64>().unwrap(), found);
    }
    for (id, found) in frames {
        let is_outside = |place: &(i64, i64)| !mask.is_masked(place.0 as u32, place.1 as u32);
        let drawn: Vec<_> = drawn(id).into_iter().filter(is_outside).collect();
        assert_eq!(without(&drawn, &found), [], "blinking in frame {id}, and not found");
        assert_eq!(without(&found, &drawn), [], "found in frame {id}, where nothing blinks");
        seen += drawn.len();
    }
    assert!(seen >= 10, "{seen} markers were drawn");
}
