//! The mask that travels beside the frames, as their consumers get it.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::time::Duration;

use support::child::{Role, role, say, told_to_go_on};
use support::*;
use uvcam_shm_ipc::mask::{LONGEST_PROVENANCE, MaskPublisher, NewMask, Run, mask_service_name};
use uvcam_shm_ipc::{Flags, Frame, FrameHeader, IpcErrorKind, Mask, Publisher, Subscriber};

const PROVENANCE: &str = "{\"method\": \"by hand\"}";

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    assert_eq!(role, "driver");
    let runs = runs(1);
    let masks = MaskPublisher::create(&settings, CAMERA, &mask(1, &runs)).unwrap();
    masks.publish(&mask(1, &runs)).unwrap();
    let mut publisher = Publisher::create(&settings, CAMERA, FRAME_BYTES, LOANS).unwrap();
    say("ready");
    while told_to_go_on() {
        masks.serve_newcomers().unwrap();
        publish_under(&mut publisher, 0, 1);
        say("sent");
    }
}

/// One run of so many pixels in each row: other runs for each number below the width.
fn runs(number: u8) -> Vec<Run> {
    (0..HEIGHT).map(|row| Run { row, start: 2, length: number.into() }).collect()
}

fn mask(number: u8, runs: &[Run]) -> NewMask<'_> {
    NewMask { mask_id: [number; 16], width: WIDTH, height: HEIGHT, runs, provenance: PROVENANCE }
}

fn masks(place: &Place, number: u8) -> MaskPublisher {
    let runs = runs(number);
    let masks = MaskPublisher::create(&place.settings, CAMERA, &mask(number, &runs)).unwrap();
    masks.publish(&mask(number, &runs)).unwrap();
    masks
}

fn publish_under(publisher: &mut Publisher, sequence: u64, number: u8) {
    let header = with(header(7, sequence), |it| it.set_mask(Some([number; 16])));
    publisher.publish(publisher.loan().unwrap(), &header).unwrap();
}

/// The mask of a frame; it must come while newcomers are served.
fn mask_of(subscriber: &mut Subscriber, frame: &Frame, masks: &MaskPublisher) -> Mask {
    let mut found = None;
    wait_until("the mask", || {
        masks.serve_newcomers().unwrap();
        found = match subscriber.mask_of(frame) {
            Ok(mask) => mask,
            Err(error) if error.kind() == IpcErrorKind::MaskPending => None,
            Err(error) => panic!("{error}"),
        };
        found.is_some()
    });
    found.unwrap()
}

#[track_caller]
fn assert_mask(mask: &Mask, number: u8) {
    assert_eq!((mask.id(), mask.width(), mask.height()), ([number; 16], WIDTH, HEIGHT));
    assert_eq!(mask.runs(), runs(number));
    assert_eq!(mask.masked_px(), u64::from(number) * u64::from(HEIGHT));
    assert_eq!(mask.provenance(), PROVENANCE);
    let expected = |x: u32| if (2..2 + u32::from(number)).contains(&x) { 0 } else { 255 };
    assert!(mask.pixels().iter().copied().eq((0..WIDTH * HEIGHT).map(|place| expected(place % WIDTH))));
}

#[test]
fn each_frame_gets_its_own_mask_whichever_is_in_force() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 1);
    let first = receive(&mut subscriber);
    assert_mask(&mask_of(&mut subscriber, &first, &masks), 1);
    // The mask changes twice while the consumer holds an old frame and has others waiting.
    for number in [2, 3] {
        masks.publish(&mask(number, &runs(number))).unwrap();
        publish_under(&mut publisher, number.into(), number);
    }
    assert_mask(&subscriber.mask_of(&first).unwrap().unwrap(), 1);
    for number in [2, 3] {
        let frame = receive(&mut subscriber);
        assert_mask(&subscriber.mask_of(&frame).unwrap().unwrap(), number);
    }
    assert_mask(&subscriber.mask_of(&first).unwrap().unwrap(), 1);
}

#[test]
fn a_mask_that_has_not_come_is_no_other_mask() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 9);
    let frame = receive(&mut subscriber);
    masks.serve_newcomers().unwrap();
    let error = subscriber.mask_of(&frame).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::MaskPending, "{error}");
    let id = "09".repeat(16);
    let expected =
        format!("mask {id} of a frame of camera \"left\" has not come yet: ask again with the next frame");
    assert_eq!(error.to_string(), expected);
    // The same identity for another size of frames is none either.
    let nine = runs(9);
    let larger = NewMask { width: 2 * WIDTH, ..mask(9, &nine) };
    masks.publish(&larger).unwrap();
    assert_eq!(subscriber.mask_of(&frame).unwrap_err().kind(), IpcErrorKind::MaskPending);
    masks.publish(&mask(9, &nine)).unwrap();
    assert_mask(&subscriber.mask_of(&frame).unwrap().unwrap(), 9);
}

#[test]
fn who_comes_late_gets_the_present_mask_and_who_flies_without_none() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    (2..9).for_each(|number| masks.publish(&mask(number, &runs(number))).unwrap());
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 8);
    let frame = receive(&mut subscriber);
    assert_mask(&mask_of(&mut subscriber, &frame, &masks), 8);
    publish(&mut publisher, 7, 1);
    let frame = receive(&mut subscriber);
    assert!(subscriber.mask_of(&frame).unwrap().is_none(), "nothing is waited for");
}

#[test]
fn an_attached_mask_is_one_as_well() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    let header = with(header(7, 0), |it| it.set_attached_mask([1; 16]));
    publisher.publish(publisher.loan().unwrap(), &header).unwrap();
    let frame = receive(&mut subscriber);
    assert_eq!(frame.header().flags, Flags::MASK_ATTACHED);
    assert_mask(&mask_of(&mut subscriber, &frame, &masks), 1);
}

#[test]
fn one_flag_says_where_the_mask_is() {
    let mut header = FrameHeader::default();
    header.set_mask(Some([1; 16]));
    header.set_attached_mask([2; 16]);
    assert_eq!((header.flags, header.mask_id, header.has_mask()), (Flags::MASK_ATTACHED, [2; 16], true));
    header.set_mask(Some([3; 16]));
    assert_eq!((header.flags, header.mask_id, header.has_mask()), (Flags::MASKED, [3; 16], true));
    header.set_mask(None);
    assert_eq!((header.flags, header.mask_id, header.has_mask()), (Flags::NONE, [0; 16], false));
}

#[test]
fn a_mask_is_read_where_the_driver_wrote_it_and_stays_while_it_is_held() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 1);
    let frame = receive(&mut subscriber);
    let held = mask_of(&mut subscriber, &frame, &masks);
    let (file, _) = behind(held.pixels().as_ptr().addr());
    assert!(file.contains(&place.settings.prefix), "{file}");
    assert_eq!(held.pixels().as_ptr(), held.clone().pixels().as_ptr());
    // Through every slot there is.
    for number in (0..200_u8).map(|number| 1 + number % 40) {
        masks.publish(&mask(number, &runs(number))).unwrap();
    }
    drop((subscriber, masks));
    assert_mask(&held, 1);
}

#[test]
fn a_grown_mask_is_made_once() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 1);
    let frame = receive(&mut subscriber);
    let mask = mask_of(&mut subscriber, &frame, &masks);
    assert_eq!(*mask.grown(0), *mask.pixels());
    let grown = mask.grown(2);
    assert!(grown.iter().zip(0..).all(|(pixel, place)| (*pixel == 0) == (place % WIDTH < 5)));
    assert_eq!(grown.as_ptr(), subscriber.mask_of(&frame).unwrap().unwrap().grown(2).as_ptr());
    assert!(mask.grown(u32::MAX).iter().all(|pixel| *pixel == 0));
}

#[test]
fn who_holds_as_many_masks_as_it_may_is_told_so() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let masks = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 1, 1);
    let frame = receive(&mut subscriber);
    let mut held = vec![mask_of(&mut subscriber, &frame, &masks)];
    for number in 2.. {
        masks.publish(&mask(number, &runs(number))).unwrap();
        publish_under(&mut publisher, number.into(), number);
        let frame = receive(&mut subscriber);
        match subscriber.mask_of(&frame) {
            Ok(mask) => held.push(mask.unwrap()),
            Err(error) => {
                assert_eq!(error.kind(), IpcErrorKind::TooManyHeld, "{error}");
                assert!(error.to_string().contains("as many masks as it may: drop one"), "{error}");
                assert_eq!(held.len(), 8);
                held.clear();
                assert_mask(&subscriber.mask_of(&frame).unwrap().unwrap(), number);
                return;
            }
        }
    }
}

#[test]
fn a_consumer_keeps_its_masks_while_drivers_are_killed_and_come_back() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    for _ in 0..3 {
        let mut driver = Role::start("driver", &place.settings);
        driver.expect("ready");
        wait_until("a frame and its mask", || {
            driver.go_on();
            driver.expect("sent");
            subscriber.wait(Duration::from_millis(20)).unwrap();
            let frames = std::iter::from_fn(|| subscriber.receive().unwrap());
            let Some(frame) = frames.last() else { return false };
            subscriber.mask_of(&frame).is_ok_and(|mask| mask.is_some_and(|mask| mask.id() == [1; 16]))
        });
        driver.kill();
    }
    // The next one flies another mask.
    let (mut publisher, masks) = (place.publisher(), masks(&place, 2));
    wait_until("the consumer", || {
        subscriber.wait(Duration::from_millis(1)).unwrap();
        publisher.subscribers() == 1
    });
    publish_under(&mut publisher, 0, 2);
    let frame = receive(&mut subscriber);
    assert_mask(&mask_of(&mut subscriber, &frame, &masks), 2);
}

#[test]
fn a_service_that_was_made_anew_is_found() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let first = masks(&place, 1);
    let mut subscriber = place.subscriber();
    publish_under(&mut publisher, 0, 1);
    let frame = receive(&mut subscriber);
    mask_of(&mut subscriber, &frame, &first);
    // As cleaners of temporary files do it.
    let services = place.settings.root_path.join("services");
    let description = std::fs::read_dir(services).unwrap().flatten().find(|file| {
        std::fs::read_to_string(file.path()).is_ok_and(|text| text.contains(&mask_service_name(CAMERA)))
    });
    std::fs::remove_file(description.unwrap().path()).unwrap();
    assert!(!first.footing().is_in_place());
    drop(first);
    let second = masks(&place, 2);
    publish_under(&mut publisher, 1, 2);
    let frame = receive(&mut subscriber);
    assert_mask(&mask_of(&mut subscriber, &frame, &second), 2);
}

#[test]
fn what_is_no_mask_is_refused_and_one_that_needs_more_room_said_to() {
    let place = Place::new();
    let masks = masks(&place, 1);
    let long = "x".repeat(LONGEST_PROVENANCE + 1);
    let outside = [Run { row: HEIGHT, start: 0, length: 1 }];
    for (wrong, expected) in [
        (NewMask { width: 0, ..mask(1, &[]) }, "mask = 0x8: use 1 to 65535 pixels a side"),
        (mask(1, &outside), "mask = 1 runs: use runs inside the image, in their order"),
        (NewMask { provenance: &long, ..mask(1, &[]) }, "provenance = 16385 bytes: use at most 16384 bytes"),
    ] {
        for error in [
            masks.publish(&wrong).unwrap_err(),
            MaskPublisher::create(&place.settings, "right", &wrong).unwrap_err(),
        ] {
            assert_eq!((error.kind(), error.to_string().as_str()), (IpcErrorKind::Setting, expected));
        }
    }
    let another = MaskPublisher::create(&place.settings, CAMERA, &mask(2, &[])).unwrap_err();
    assert_eq!(another.kind(), IpcErrorKind::AlreadyPublishing, "{another}");
    let large = NewMask { width: 1920, height: 1200, ..mask(1, &[]) };
    assert!(masks.has_room_for(&mask(1, &runs(9))) && !masks.has_room_for(&large));
}
