//! The mask that travels beside the frames, from the real driver to its consumers.
#![allow(clippy::unwrap_used)]

use std::collections::HashSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use image::GrayImage;
use rustix::process::Signal;
use serde_json::Value;
use uvcam_masker::Mask;
use uvcam_shm_ipc::health::MaskMode;
use uvcam_shm_ipc::{Flags, Frame, IpcErrorKind, Subscriber};
use uvcam_tests::{Stage, health_where, next_frame, simulated, stderr, wait_until};

const CONSUMERS: usize = 4;
const CHANGES: u64 = 200;
const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

/// A mask for each number, none like another.
fn numbered(number: u64) -> Mask {
    Mask::from_fn(WIDTH, HEIGHT, |x, y| u64::from(y * WIDTH + x) <= 3 * number)
}

/// The mask of a frame, where it has come: one whose content has the identity that the frame names.
fn mask_of(subscriber: &mut Subscriber, frame: &Frame) -> Option<uvcam_shm_ipc::Mask> {
    let mask = match subscriber.mask_of(frame) {
        Ok(mask) => mask.unwrap(),
        Err(error) if error.kind() == IpcErrorKind::MaskPending => return None,
        Err(error) => panic!("{error}"),
    };
    let image = GrayImage::from_raw(mask.width(), mask.height(), mask.pixels().to_vec()).unwrap();
    let content = Mask::from_gray(&image).unwrap();
    assert_eq!((mask.id(), content.id().0), (frame.header().mask_id, frame.header().mask_id));
    let runs = mask.runs().iter().map(|run| (run.row, run.start, run.length));
    assert!(runs.eq(content.runs().iter().map(|run| (run.row, run.start, run.length))));
    assert_eq!(mask.masked_px(), content.masked_px());
    Some(mask)
}

/// Masked pixels of a frame that are not black.
fn not_black(frame: &Frame, mask: &uvcam_shm_ipc::Mask) -> usize {
    let rows: Vec<&[u8]> = frame.rows().collect();
    let masked = mask
        .runs()
        .iter()
        .flat_map(|run| rows[run.row as usize][run.start as usize..][..run.length as usize].iter());
    masked.filter(|pixel| **pixel != 0).count()
}

/// Waits for a frame whose mask has come.
fn next_with_mask(subscriber: &mut Subscriber) -> (Frame, uvcam_shm_ipc::Mask) {
    let mut found = None;
    wait_until("a frame and its mask", || {
        let frame = next_frame(subscriber);
        found = mask_of(subscriber, &frame).map(|mask| (frame, mask));
        found.is_some()
    });
    found.unwrap()
}

/// What a consumer of the changing masks has seen.
#[derive(Default)]
struct Seen {
    masks: HashSet<[u8; 16]>,
    frames: u64,
    /// Frames whose mask had not come after another one had.
    pending: u64,
}

fn consume(mut subscriber: Subscriber, newest: &AtomicU64, done: &AtomicBool) -> Seen {
    let mut seen = Seen::default();
    while !done.load(Ordering::Relaxed) {
        subscriber.wait(Duration::from_millis(100)).unwrap();
        while let Some(frame) = subscriber.receive().unwrap() {
            let Some(mask) = mask_of(&mut subscriber, &frame) else {
                seen.pending += u64::from(!seen.masks.is_empty());
                continue;
            };
            assert!(frame.header().flags.contains(Flags::MASKED));
            assert_eq!(not_black(&frame, &mask), 0, "frame {}", frame.header().sequence);
            seen.frames += 1;
            if seen.masks.insert(mask.id()) {
                newest.store((mask.masked_px() - 1) / 3, Ordering::Relaxed);
            }
        }
    }
    seen
}

#[test]
fn no_frame_is_paired_with_another_s_mask_while_masks_change() {
    let stage = Stage::new(&format!(
        "[[camera]]\nname = \"left\"\nsource = {{ kind = \"simulated\", serial = \"left\", still = true }}\n\
         width = {WIDTH}\nheight = {HEIGHT}\nfps = 120\nexposure_us = 1000\nmask = \"left.png\"\n"
    ));
    let write = |number| numbered(number).save(&stage.file("left.png"), &[]).unwrap();
    write(0);
    let driver = stage.driver();
    let (newest, done): ([AtomicU64; CONSUMERS], _) = (Default::default(), AtomicBool::new(false));
    newest.iter().for_each(|newest| newest.store(u64::MAX, Ordering::Relaxed));
    let all_have = |number| newest.iter().all(|newest| newest.load(Ordering::Relaxed) == number);
    std::thread::scope(|scope| {
        let consumers: Vec<_> = newest
            .iter()
            .map(|newest| {
                let (subscriber, done) = (stage.subscriber("left"), &done);
                scope.spawn(move || consume(subscriber, newest, done))
            })
            .collect();
        wait_until("the first mask", || all_have(0));
        for number in 1..=CHANGES {
            write(number);
            driver.signal(Signal::HUP);
            wait_until("the next mask", || all_have(number) || consumers.iter().any(|it| it.is_finished()));
        }
        done.store(true, Ordering::Relaxed);
        for consumer in consumers {
            let seen = consumer.join().unwrap();
            println!("{} frames, {} masks", seen.frames, seen.masks.len());
            assert_eq!((seen.masks.len() as u64, seen.pending), (CHANGES + 1, 0));
        }
    });
    let health = health_where("a record", &mut stage.health("left"), |_| true);
    assert_eq!((health.lost, health.epochs, health.mask_mode()), (0, 1, Ok(MaskMode::Blank)));
    assert!(driver.stop().status.success());
}

#[test]
fn attached_masks_leave_frames_as_they_are_and_everything_says_so() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + "mask_mode = \"attach\"\n"));
    let texts = [("Method", "by hand".to_owned())];
    let mask = Mask::from_fn(752, 480, |x, y| x > 100 && y > 300);
    mask.save(&stage.file("left.png"), &texts).unwrap();
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    let (frame, attached) = next_with_mask(&mut subscriber);
    assert_eq!(frame.header().flags & (Flags::MASKED | Flags::MASK_ATTACHED), Flags::MASK_ATTACHED);
    assert_eq!(frame.header().mask_id, mask.id().0);
    assert!(not_black(&frame, &attached) > 0, "the airframe is in sight");
    assert_eq!(attached.provenance(), r#"{"Method":"by hand"}"#);
    let health = health_where("a record", &mut stage.health("left"), |health| health.mask_id != [0; 16]);
    assert_eq!(health.mask_mode(), Ok(MaskMode::Attach));
    let json = |words: &[&str]| -> Value {
        let output = stage.output(words);
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    assert_eq!(json(&["stats", "left", "--json"])[0]["mask_mode"], "attach");
    assert_eq!(json(&["watch", "left", "--frames", "3", "--json"])["mask_mode"], "attach");
    let words = format!("mask                               {}, attached: frames are NOT BLANKED", mask.id());
    for command in [&["stats", "left"][..], &["watch", "left", "--frames", "3"]] {
        let output = stage.output(command);
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        let line = told.lines().find(|line| line.starts_with("mask ")).unwrap();
        assert_eq!(line.split_whitespace().collect::<Vec<_>>(), words.split_whitespace().collect::<Vec<_>>());
    }
    let said = stderr(&driver.stop());
    assert!(said.contains("NOT BLANKED, with ") && said.contains("(mask_mode = \"attach\")"), "{said}");
}

#[test]
fn a_camera_whose_mask_would_be_attached_does_not_fly_without_it() {
    let stage = Stage::new(&(simulated("left", "left.png", "") + "mask_mode = \"attach\"\n"));
    let mut subscriber = stage.subscriber("left");
    for write in [|_: &Stage| {}, |stage: &Stage| _ = stage.write_mask("left.png", (480, 752), 10)] {
        write(&stage);
        let output = stage.output(&["run", "--duration", "20"]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(subscriber.receive().unwrap().is_none());
    }
}

#[test]
fn consumers_get_the_masks_of_one_driver_after_the_other() {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    let mut early = stage.subscriber("left");
    for rows in [10, 20, 30] {
        let mask = stage.write_mask("left.png", (752, 480), rows);
        let driver = stage.driver();
        wait_until("frames of this driver and their mask", || {
            let (frame, found) = next_with_mask(&mut early);
            found.id() == mask.id().0 && not_black(&frame, &found) == 0
        });
        let (_, found) = next_with_mask(&mut stage.subscriber("left"));
        assert_eq!(found.id(), mask.id().0, "who comes late gets the present one");
        driver.kill();
    }
    assert_eq!(early.epochs(), 3);
}

#[test]
fn a_mask_that_needs_more_room_than_the_one_before_is_given_out() {
    let stage = Stage::new(&simulated("left", "left.png", ""));
    stage.write_mask("left.png", (752, 480), 10);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_with_mask(&mut subscriber);
    // 90240 runs.
    let ragged = Mask::from_fn(752, 480, |x, y| x % 4 == 0 && y > 0);
    ragged.save(&stage.file("left.png"), &[]).unwrap();
    driver.signal(Signal::HUP);
    wait_until("the ragged mask", || next_with_mask(&mut subscriber).1.id() == ragged.id().0);
    assert!(driver.stop().status.success());
}
