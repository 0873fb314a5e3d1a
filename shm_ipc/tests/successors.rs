//! What a driver leaves to the one that comes after it: the count of what the device produced, and frames that nobody has read yet.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::fs;

use support::child::{Role, role, say, told_to_go_on};
use support::*;
use uvcam_shm_ipc::{IpcErrorKind, Publisher, Settings};

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    match role.as_str() {
        "loser" => publish_and_lose(&settings),
        unknown => panic!("no role {unknown}"),
    }
}

/// A driver that publishes three frames of one epoch, loses two more, and waits.
fn publish_and_lose(settings: &Settings) {
    let mut publisher = Publisher::create(settings, CAMERA, FRAME_BYTES, LOANS).unwrap();
    let epoch = publisher.begin_epoch();
    say("ready");
    told_to_go_on();
    (0..3).for_each(|sequence| _ = publish(&mut publisher, epoch, sequence));
    publisher.count_lost(2);
    say("done");
    told_to_go_on();
}

#[test]
fn a_consumer_that_slept_over_drivers_is_told_all_that_it_missed() {
    let place = Place::new();
    let mut sleeper = place.subscriber();
    let run = |ends: fn(Role)| {
        let mut driver = Role::start("loser", &place.settings);
        driver.expect("ready");
        driver.go_on();
        driver.expect("done");
        ends(driver);
    };
    {
        let mut publisher = place.publisher();
        meet(&publisher, &mut sleeper);
        let epoch = publisher.begin_epoch();
        publish(&mut publisher, epoch, 0);
        publisher.count_lost(1);
    }
    // Stopped and killed ones; it never hears of any but the last.
    for ends in [Role::leave, Role::kill, Role::kill, Role::leave] {
        run(ends);
    }
    let mut publisher = place.publisher();
    let epoch = publisher.begin_epoch();
    publish(&mut publisher, epoch, 0);
    assert_eq!(drain(&mut sleeper), [(0, 0), (0, 1 + 4 * 5)], "first what was sent first");
    let epoch = publisher.begin_epoch();
    publish(&mut publisher, epoch, 0);
    assert_eq!(drain(&mut sleeper), [(0, 0)]);
    assert_eq!((sleeper.frames(), sleeper.lost(), sleeper.epochs()), (3, 21, 3));
}

/// As whoever cleans up shared memory does it.
fn remove_page(place: &Place) {
    let mut files = place.shared_memory().into_iter();
    let (page, _) = files.find(|(name, _)| name.ends_with(".wake")).unwrap();
    fs::remove_file(format!("/dev/shm/{page}")).unwrap();
}

#[test]
fn where_nothing_is_left_of_the_driver_before_all_of_the_new_count_is_told() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    for _ in 0..2 {
        let mut publisher = place.publisher();
        meet(&publisher, &mut subscriber);
        publisher.count_lost(3);
        let epoch = publisher.begin_epoch();
        publish(&mut publisher, epoch, 0);
        drop(publisher);
        remove_page(&place);
    }
    assert_eq!(drain(&mut subscriber), [(0, 0), (0, 3)]);
}

#[test]
fn a_driver_whose_page_was_removed_in_flight_leaves_another_one() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    let mut publisher = place.publisher();
    meet(&publisher, &mut subscriber);
    let epoch = publisher.begin_epoch();
    publish(&mut publisher, epoch, 0);
    remove_page(&place);
    publisher.count_lost(3);
    drop(publisher);
    let mut publisher = place.publisher();
    let epoch = publisher.begin_epoch();
    publish(&mut publisher, epoch, 0);
    assert_eq!(drain(&mut subscriber), [(0, 0), (0, 3)]);
}

#[test]
fn a_new_drivers_frames_come_after_the_rest_of_the_old_ones() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    let mut publisher = place.publisher();
    meet(&publisher, &mut subscriber);
    (0..4).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    let held: Vec<_> = (0..place.settings.borrowed).map(|_| receive(&mut subscriber)).collect();
    drop(publisher);
    let mut publisher = place.publisher();
    publish(&mut publisher, 8, 10);
    assert_eq!(subscriber.receive().unwrap_err().kind(), IpcErrorKind::TooManyHeld);
    held.iter().for_each(assert_pixels);
    drop(held);
    assert_eq!(drain(&mut subscriber), [(2, 0), (3, 0), (10, 0)]);
}
