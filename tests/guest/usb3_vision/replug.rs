//! Plugs that are pulled: what it costs a sibling, and what it costs the driver in the long run.

use std::fs;

use uvcam_emulated::usb::Plugged;
use uvcam_emulated::usb3_vision::{Camera, Identity};
use uvcam_tests::{Process, Stage, children, next_frame, wait_until};

use super::{SIZE, camera};

const CYCLES: usize = 200;
/// Cycles after which caches and pools have their size, and between two looks at what the driver holds.
const STEP: usize = 20;
/// Most that memory may grow by in that many cycles, KiB: pages of an allocator come and go.
const GROWTH_KIB: i64 = 56;
/// Most that it may grow by once and for all: a device that is closed while the next one is opened gives an allocator more to keep.
const ONCE_KIB: i64 = 4096;

fn plug(serial: &str) -> Plugged<Camera> {
    Plugged::new(Camera::new(Identity::with_serial(serial)))
}

#[test]
fn unplugging_one_camera_costs_the_other_nothing() {
    let (left, _right) = (plug("U3V1"), plug("U3V2"));
    let right = camera("right", "U3V2").replace("mask.png", "right.png");
    let stage = Stage::new(&(camera("left", "U3V1") + &right));
    for mask in ["mask.png", "right.png"] {
        stage.write_mask(mask, SIZE, 100);
    }
    let (mut lefts, mut rights) = (stage.subscriber("left"), stage.subscriber("right"));
    let _driver = stage.driver();
    next_frame(&mut lefts);
    next_frame(&mut rights);
    let before = rights.frames();
    left.unplug();
    for _ in 0..60 {
        next_frame(&mut rights);
    }
    let _left = plug("U3V1");
    wait_until("the left camera is back", || {
        while rights.receive().unwrap().is_some() {}
        lefts.receive().unwrap().is_some() && lefts.epochs() == 2
    });
    for _ in 0..60 {
        next_frame(&mut rights);
    }
    assert_eq!((rights.lost(), rights.epochs()), (0, 1));
    println!(
        "\n| unplugged beside another camera | {} frames of the other | {} | - |",
        rights.frames() - before,
        rights.lost()
    );
}

/// What a process and its children hold.
#[derive(Debug)]
struct Holdings {
    descriptors: usize,
    threads: usize,
    resident_kib: u64,
}

fn holdings(process: &Process) -> Holdings {
    let processes: Vec<u32> = children(process.id()).into_iter().chain([process.id()]).collect();
    let count = |what: &str| -> usize {
        processes.iter().map(|id| fs::read_dir(format!("/proc/{id}/{what}")).unwrap().count()).sum()
    };
    Holdings { descriptors: count("fd"), threads: count("task"), resident_kib: process.resident_kib() }
}

#[test]
fn two_hundred_replugs_leave_nothing_behind() {
    let stage = Stage::new(&camera("left", "U3V1"));
    stage.write_mask("mask.png", SIZE, 100);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    let mut seen = Vec::new();
    for cycle in 1..=CYCLES {
        let device = plug("U3V1");
        wait_until("a frame of the new epoch", || {
            subscriber.receive().unwrap().is_some() && subscriber.epochs() == cycle as u64
        });
        if cycle.is_multiple_of(STEP) {
            seen.push(holdings(&driver));
        }
        device.unplug();
    }
    let (early, late) = (seen.first().unwrap(), seen.last().unwrap());
    println!("\n| {CYCLES} times plugged in | from {early:?} to {late:?} | - | - |");
    assert_eq!((late.descriptors, late.threads), (early.descriptors, early.threads));
    let grown = |from: &Holdings, to: &Holdings| to.resident_kib as i64 - from.resident_kib as i64;
    // What is left behind each time grows in all steps.
    let mut growths: Vec<_> = seen.windows(2).map(|pair| grown(&pair[0], &pair[1])).collect();
    growths.sort_unstable();
    assert!(growths[growths.len() / 2] <= GROWTH_KIB, "{seen:?}");
    assert!(grown(early, late) <= ONCE_KIB, "{seen:?}");
}
