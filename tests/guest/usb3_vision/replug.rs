//! Plugs that are pulled: what it costs a sibling, and what it costs the driver in the long run.

use std::fs;

use uvcam_tests::usb::Plugged;
use uvcam_tests::usb3_vision::{Camera, Identity};
use uvcam_tests::{Process, Stage, next_frame, wait_until};

use super::{SIZE, camera};

const CYCLES: usize = 200;
/// Cycles after which caches and pools have their size.
const WARM_UP: usize = 20;

fn plug(serial: &str) -> Plugged<Camera> {
    Plugged::new(Camera::new(Identity::with_serial(serial)))
}

#[test]
fn unplugging_one_camera_costs_the_other_nothing() {
    let (left, _right) = (plug("U3V1"), plug("U3V2"));
    let stage = Stage::new(&(camera("left", "U3V1") + &camera("right", "U3V2")));
    stage.write_mask("mask.png", SIZE, 100);
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
        while rights.next().unwrap().is_some() {}
        lefts.next().unwrap().is_some() && lefts.epochs() == 2
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

/// What a process holds.
#[derive(Debug)]
struct Holdings {
    descriptors: usize,
    threads: usize,
    resident_kib: u64,
}

fn holdings(process: &Process) -> Holdings {
    let count = |what: &str| fs::read_dir(format!("/proc/{}/{what}", process.id())).unwrap().count();
    Holdings { descriptors: count("fd"), threads: count("task"), resident_kib: process.resident_kib() }
}

#[test]
fn two_hundred_replugs_leave_nothing_behind() {
    let stage = Stage::new(&camera("left", "U3V1"));
    stage.write_mask("mask.png", SIZE, 100);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    let mut early = None;
    for cycle in 1..=CYCLES {
        let device = plug("U3V1");
        wait_until("a frame of the new epoch", || {
            subscriber.next().unwrap().is_some() && subscriber.epochs() == cycle as u64
        });
        match cycle {
            WARM_UP => early = Some(holdings(&driver)),
            CYCLES => {
                let (early, late) = (early.take().unwrap(), holdings(&driver));
                println!("\n| {CYCLES} times plugged in | from {early:?} to {late:?} | - | - |");
                assert_eq!((late.descriptors, late.threads), (early.descriptors, early.threads));
                // Pages of an allocator come and go.
                assert!(late.resident_kib <= early.resident_kib + 512, "from {early:?} to {late:?}");
            }
            _ => {}
        }
        device.unplug();
    }
}
