//! libuvcam, as programs in C and C++ use it: installed by its Makefile, found by pkg-config and CMake, beside a running driver.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;

use rustix::process::{Pid, Signal, kill_process};
use uvcam::camera::simulated::airframe;
use uvcam_masker::Mask;
use uvcam_shm_ipc::mask::{MaskPublisher, NewMask, Run};
use uvcam_shm_ipc::{Frame, FrameHeader, PixelFormat};
use uvcam_tests::{Process, SharedMemory, Stage, c, next_frame, simulated, stderr, wait_until};

/// Width and height of the simulated camera, px.
const SIZE: (u32, u32) = (752, 480);
/// Rows that the programs find black.
const MASKED_ROWS: u32 = 40;
/// What finds errors while a program runs. A program that it ends did not succeed.
const SANITIZERS: &[&str] = &["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
const WARNINGS: &[&str] = &["-Wall", "-Wextra", "-pedantic", "-Werror"];

fn tests() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c")
}

/// Builds a program of this test's folder.
fn compiled(source: &str, name: &str, flags: &[&str]) -> PathBuf {
    c::compiled(&tests().join(source), name, flags)
}

/// A program that reads a camera of the stage.
fn consumer(program: &Path, stage: &Stage, camera: &str) -> Command {
    c::consumer(program, stage.settings(), camera)
}

/// A stage whose camera "left" flies a mask of the lower rows.
fn masked() -> Stage {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    stage.write_mask("left.png", SIZE, MASKED_ROWS);
    stage
}

/// What a consumer saw of a frame.
#[derive(Debug)]
struct Seen {
    /// Epoch and sequence.
    place: (u64, u64),
    lost_before: u64,
    epoch_changed: bool,
}

impl Seen {
    fn new(frame: &Frame) -> Self {
        Seen {
            place: (frame.header().epoch, frame.header().sequence),
            lost_before: frame.lost_before(),
            epoch_changed: frame.epoch_changed(),
        }
    }
}

/// What a program in C told of its frames.
fn told(output: &Output) -> Vec<Seen> {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}\n{said}\n{}", output.status, stderr(output));
    let (frames, counters) = said.split_once("counters ").unwrap_or_else(|| panic!("no counters: {said}"));
    let numbers =
        |line: &str| -> Vec<u64> { line.split_whitespace().map(|number| number.parse().unwrap()).collect() };
    let lines: Vec<Vec<u64>> = frames.lines().map(numbers).collect();
    for line in &lines {
        assert_eq!(line[4..], [1, 1], "not in shared memory, or not blanked: {line:?}");
    }
    let (lost, begun) = lines.iter().fold((0, 1), |(lost, begun), line| (lost + line[2], begun + line[3]));
    assert_eq!(numbers(counters), [lines.len() as u64, lost, begun, 0, 1], "{said}");
    let seen = |line: &Vec<u64>| Seen {
        place: (line[0], line[1]),
        lost_before: line[2],
        epoch_changed: line[3] == 1,
    };
    lines.iter().map(seen).collect()
}

/// How many frames the device had produced at each frame, by what a consumer got and lost. A busy machine may cost one consumer frames that
/// another one gets; what both know of the device is the same.
fn produced(frames: &[Seen]) -> BTreeMap<(u64, u64), u64> {
    let mut produced = 0;
    let count = |seen: &Seen| {
        produced += seen.lost_before + 1;
        (seen.place, produced)
    };
    frames.iter().map(count).collect()
}

#[test]
fn consumers_in_c_and_cpp_get_what_one_in_rust_gets_also_of_the_next_driver() {
    let programs = [
        compiled("consumer.c", "consumer-c", &[&["-std=c99"], SANITIZERS].concat()),
        compiled("consumer.cpp", "consumer-cpp", &[&["-std=c++17"], SANITIZERS].concat()),
    ];
    let stage = masked();
    // Before there is a driver.
    let started = programs.map(|program| Process::start(&mut consumer(&program, &stage, "left")));
    let driver = stage.driver();
    let mut subscriber = stage.subscriber("left");
    let mut ours: Vec<Seen> = (0..90).map(|_| Seen::new(&next_frame(&mut subscriber))).collect();
    driver.kill();
    let driver = stage.driver();
    while subscriber.epochs() < 2 || ours.len() < 180 {
        ours.push(Seen::new(&next_frame(&mut subscriber)));
    }
    let outputs = started.map(Process::stop);
    drop(driver);
    for output in outputs {
        let theirs = told(&output);
        assert_eq!(theirs.iter().filter(|seen| seen.epoch_changed).count(), 1, "{theirs:?}");
        let theirs = produced(&theirs);
        let common: Vec<((u64, u64), i128)> = produced(&ours)
            .into_iter()
            .filter_map(|(place, ours)| Some((place, i128::from(*theirs.get(&place)?) - i128::from(ours))))
            .collect();
        // One of them came earlier, by as many frames from the first to the last.
        assert!(common.iter().all(|(_, earlier)| *earlier == common[0].1), "{common:?}");
        assert!(common.len() > 120 && common[0].0.0 != common[common.len() - 1].0.0, "{common:?}");
    }
}

#[test]
fn misuse_is_an_error_and_nothing_else() {
    let stage = masked();
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    let watched = compiled("misuse.c", "misuse-sanitized", &[&["-std=c99"], SANITIZERS].concat());
    let output = c::succeeds(&mut consumer(&watched, &stage, "left"));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "all refused\n");
    // The whole process under a machine that knows every byte, also those of the library.
    let plain = compiled("misuse.c", "misuse", &["-std=c99", "-g"]);
    let watched = consumer(&plain, &stage, "left");
    let mut valgrind = Command::new("valgrind");
    valgrind.args([
        "--quiet",
        "--error-exitcode=99",
        "--leak-check=full",
        "--errors-for-leak-kinds=definite",
    ]);
    valgrind.arg(watched.get_program()).args(watched.get_args());
    valgrind.env("LD_LIBRARY_PATH", c::prefix().join("lib"));
    let output = c::succeeds(&mut valgrind);
    assert_eq!(
        (String::from_utf8_lossy(&output.stdout).as_ref(), stderr(&output).as_str()),
        ("all refused\n", "")
    );
    drop(driver);
}

#[test]
fn cpp_does_without_exceptions_and_opencv_without_a_copy() {
    let stage = masked();
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));
    let flags = [&["-std=c++20", "-fno-exceptions", "-fno-rtti"], SANITIZERS].concat();
    let expected = compiled("expected.cpp", "expected", &flags);
    let output = c::succeeds(&mut consumer(&expected, &stage, "left"));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "as expected\n");

    let flags = ["-std=c++17", "-isystem", "/usr/include/opencv4", "-Wl,--no-as-needed", "-lopencv_core"];
    let matrix = compiled("matrix.cpp", "matrix", &flags);
    let output = c::succeeds(&mut consumer(&matrix, &stage, "left"));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "a matrix\n");
    // With a stand-in for the window.
    let here = format!("-I{}", tests().display());
    let window = compiled(
        "../../../shm_ipc/c/examples/opencv_window.cpp",
        "opencv_window",
        &[&[here.as_str()], &flags[..]].concat(),
    );
    let output = c::succeeds(&mut consumer(&window, &stage, "left"));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "left: 752 x 480\n".repeat(30));
    drop(driver);
}

/// Runs of the mask of this number: as many columns from the second on.
fn runs(number: u8, height: u32) -> Vec<Run> {
    (0..height).map(|row| Run { row, start: 2, length: number.into() }).collect()
}

fn mask(number: u8, (width, height): (u32, u32), runs: &[Run]) -> NewMask<'_> {
    NewMask { mask_id: [number; 16], width, height, runs, provenance: "{\"method\": \"by hand\"}" }
}

#[test]
fn each_frame_gets_its_own_mask_while_masks_change() {
    const SIZE: (u32, u32) = (64, 8);
    let program = compiled("masks.cpp", "masks", &[&["-std=c++17"], SANITIZERS].concat());
    let memory = SharedMemory::new();
    let mut publisher = memory.publisher("left", (SIZE.0 * SIZE.1) as usize, 4);
    let masks = MaskPublisher::create(&memory.settings(), "left", &mask(1, SIZE, &runs(1, SIZE.1))).unwrap();
    let mut command = c::consumer(&program, memory.settings(), "left");
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let (sender, told) = mpsc::channel();
    let listening = std::thread::spawn(move || lines.for_each(|line| sender.send(line).unwrap()));
    wait_until("the consumer", || publisher.subscribers() > 0);
    for sequence in 0..200u64 {
        let number = (sequence % 40) as u8 + 1;
        masks.publish(&mask(number, SIZE, &runs(number, SIZE.1))).unwrap();
        let mut header = FrameHeader::new(SIZE.0, SIZE.1, SIZE.0, PixelFormat::Mono8);
        header.sequence = sequence;
        header.set_mask(Some([number; 16]));
        let mut slot = publisher.loan().unwrap();
        slot.pixels_mut().fill(255);
        slot.pixels_mut().chunks_mut(SIZE.0 as usize).for_each(|row| row[2..2 + usize::from(number)].fill(0));
        publisher.publish(slot, &header).unwrap();
        let mut said = None;
        wait_until("the mask of a frame", || {
            masks.serve_newcomers().unwrap();
            said = told.try_recv().ok();
            said.is_some()
        });
        assert_eq!(said.unwrap(), format!("mask {number}"));
    }
    kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
    assert!(child.wait().unwrap().success());
    listening.join().unwrap();
}

#[test]
fn headers_are_good_c_and_cpp_to_gcc_and_clang() {
    for (language, header, standards) in [
        ("c", "uvcam.h", &["c99", "c11"][..]),
        ("c++", "uvcam.h", &["c++11"]),
        ("c++", "uvcam.hpp", &["c++17", "c++20"]),
    ] {
        let unit = c::folder().join(format!("{header}.{language}"));
        std::fs::write(&unit, format!("#include <{header}>\n")).unwrap();
        for compiler in [if language == "c" { "gcc" } else { "g++" }, "clang"] {
            for standard in standards {
                let mut command = Command::new(compiler);
                command.args(WARNINGS).arg(format!("-std={standard}")).args([
                    "-fsyntax-only",
                    "-x",
                    language,
                ]);
                command.arg(&unit).args(c::pkg_config(&["--cflags"]));
                c::succeeds(&mut command);
            }
        }
    }
}

/// Centres of the simulated markers: spots of their brightness outside the airframe, which are squares of 3 px.
fn spots(frame: &Frame) -> Vec<(u32, u32)> {
    let mut spots: Vec<(u32, u32)> = Vec::new();
    for (y, row) in (0..).zip(frame.rows()) {
        for (x, _) in (0..).zip(row).filter(|(_, pixel)| **pixel == 240) {
            if !spots.iter().any(|spot| is_near(*spot, (x, y))) {
                spots.push((x, y));
            }
        }
    }
    spots
}

fn is_near(one: (u32, u32), other: (u32, u32)) -> bool {
    one.0.abs_diff(other.0) <= 5 && one.1.abs_diff(other.1) <= 5
}

/// What the example found: markers by the sequence of their frame.
fn markers(output: &Output) -> BTreeMap<u64, Vec<(u32, u32)>> {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complete = said.rsplit_once('\n').unwrap().0;
    let parsed = complete.lines().map(|line| {
        let (frame, found) = line.strip_prefix("frame ").unwrap().split_once(" lost:").unwrap();
        let point = |text: &str| {
            let (x, y) = text.split_once(',').unwrap();
            (x.parse().unwrap(), y.parse().unwrap())
        };
        (frame.split_once(',').unwrap().0.parse().unwrap(), found.split_whitespace().map(point).collect())
    });
    parsed.collect()
}

#[test]
fn examples_built_by_cmake_tell_the_rate_and_find_the_markers() {
    let folder = c::folder().join("examples");
    let _ = std::fs::remove_dir_all(&folder);
    let mut configure = Command::new("cmake");
    configure.arg("-S").arg(tests()).arg("-B").arg(&folder);
    configure.arg(format!("-DCMAKE_PREFIX_PATH={}", c::prefix().display()));
    configure.arg(format!("-DEXAMPLES={}", c::package().join("examples").display()));
    c::succeeds(&mut configure);
    c::succeeds(Command::new("cmake").arg("--build").arg(&folder));

    // Lit, as for a mask: without one, the airframe is full of markers.
    let lit = |mask| simulated("left", mask, "").replace("exposure_us = 1000", "exposure_us = 5000");
    let shown = airframe(SIZE.0, SIZE.1);
    for (mask, is_masked) in [("none", false), ("left.png", true)] {
        let stage = Stage::new(&lit(mask));
        Mask::from_fn(SIZE.0, SIZE.1, &shown).save(&stage.file("left.png"), &[]).unwrap();
        let driver = stage.driver();
        let mut subscriber = stage.subscriber("left");
        next_frame(&mut subscriber);
        let rate =
            is_masked.then(|| Process::start(&mut consumer(&folder.join("rate_and_loss"), &stage, "left")));
        let detector = Process::start(&mut consumer(&folder.join("uvdar_markers"), &stage, "left"));
        let frames: Vec<(u64, Vec<(u32, u32)>)> = (0..150)
            .map(|_| {
                let frame = next_frame(&mut subscriber);
                (frame.header().sequence, spots(&frame))
            })
            .collect();
        if let Some(rate) = rate {
            let said = String::from_utf8(rate.stop().stdout).unwrap();
            assert!(said.lines().count() > 0, "no rate in 150 frames");
            assert!(said.lines().all(|line| line.ends_with(" frames a second, 0 lost")), "{said}");
        }
        let found = markers(&detector.stop());
        drop(driver);
        let mut compared = 0;
        for (sequence, spots) in &frames {
            let Some(found) = found.get(sequence) else { continue };
            let on_airframe = found.iter().filter(|(x, y)| shown(*x, *y)).count();
            if is_masked {
                assert_eq!(on_airframe, 0, "frame {sequence}: {found:?}");
                assert_eq!(found.len(), spots.len(), "frame {sequence}: {found:?}, expected {spots:?}");
                assert!(
                    spots.iter().all(|spot| found.iter().any(|marker| is_near(*spot, *marker))),
                    "{found:?}, {spots:?}"
                );
            } else {
                assert!(on_airframe > 0, "frame {sequence}: nothing on an unmasked airframe");
            }
            compared += 1;
        }
        assert!(compared > 60, "the example saw {compared} of 150 frames");
    }
}
