//! What a consumer gets of what a driver publishes.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::collections::BTreeSet;
use std::time::Duration;

use support::*;
use uvcam_shm_ipc::{FrameHeader, LoanError, PixelFormat, Publisher, Settings, monotonic_ns};

#[test]
fn every_frame_arrives_in_order_and_untouched() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let mut last_sent_ns = monotonic_ns();
    for sequence in 0..200 {
        assert_eq!(publish(&mut publisher, 7, sequence), 1, "consumers reached");
        let frame = receive(&mut subscriber);
        let sent_ns = frame.header().send_monotonic_ns;
        assert!((last_sent_ns..=monotonic_ns()).contains(&sent_ns));
        last_sent_ns = sent_ns;
        let FrameHeader { counting, produced, .. } = *frame.header();
        assert!(counting > 0 && produced == sequence + 1, "{counting}, {produced}");
        let sent = with(header(7, sequence), |it| {
            (it.counting, it.produced, it.send_monotonic_ns) = (counting, produced, sent_ns);
        });
        assert_eq!(*frame.header(), sent);
        assert_pixels(&frame);
        assert!(!frame.epoch_changed());
    }
    assert!(subscriber.receive().unwrap().is_none());
    let counts = (subscriber.frames(), subscriber.lost(), subscriber.epochs(), subscriber.rejected());
    assert_eq!(counts, (200, 0, 1, 0));
}

#[test]
fn what_overflowed_and_what_was_never_published_is_counted_exactly() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    publish_after_loss(&mut publisher, 7, 0, 5);
    assert_eq!(drain(&mut subscriber), [(0, 0)], "before the first frame, the consumer was not there");
    publish_after_loss(&mut publisher, 7, 1, 3);
    assert_eq!(drain(&mut subscriber), [(1, 3)]);
    // Of 9 frames, 4 stay in the buffer; with the 5 that give way goes the word of 2 more.
    (2..11).for_each(|sequence| {
        publish_after_loss(&mut publisher, 7, sequence, if sequence == 4 { 2 } else { 0 });
    });
    assert_eq!(drain(&mut subscriber), [(7, 7), (8, 0), (9, 0), (10, 0)]);
    assert_eq!((subscriber.frames(), subscriber.lost()), (6, 10));
}

#[test]
fn latest_passes_over_older_frames_without_calling_them_lost() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    (0..3).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    let frame = subscriber.receive_latest().unwrap().unwrap();
    assert_eq!((frame.header().sequence, frame.lost_before()), (2, 0));
    assert_pixels(&frame);
    publish_after_loss(&mut publisher, 7, 3, 4);
    publish(&mut publisher, 7, 4);
    let frame = subscriber.receive_latest().unwrap().unwrap();
    assert_eq!(
        (frame.header().sequence, frame.lost_before()),
        (4, 4),
        "a loss among those passed over is told"
    );
    assert!(subscriber.receive_latest().unwrap().is_none());
    assert_eq!((subscriber.frames(), subscriber.lost()), (5, 4));
}

#[test]
fn latest_works_with_all_but_one_frame_held() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    publish(&mut publisher, 7, 0);
    let held = receive(&mut subscriber);
    (1..4).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    assert_eq!(subscriber.receive_latest().unwrap().unwrap().header().sequence, 3);
    assert_pixels(&held);
}

#[test]
fn consumers_that_do_not_move_cost_the_driver_nothing() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscribers: Vec<_> = (0..2).map(|_| place.subscriber()).collect();
    // Each holds all that it may, has a full buffer, and was asleep once, so that the driver notifies it.
    let mut held = Vec::new();
    for subscriber in &mut subscribers {
        assert!(!subscriber.wait(Duration::from_millis(1)).unwrap());
    }
    for sequence in 0..2 {
        publish(&mut publisher, 7, sequence);
        held.extend(subscribers.iter_mut().map(receive));
    }
    for sequence in 2..2000 {
        // All slots that the driver may have, out at once, every time.
        let slots: Vec<_> = (0..LOANS).map(|_| publisher.loan().unwrap()).collect();
        for slot in slots {
            assert_eq!(publisher.publish(slot, &header(7, sequence)).unwrap(), 2);
        }
    }
    held.iter().for_each(assert_pixels);
}

#[test]
fn a_consumer_may_hold_as_many_frames_as_agreed() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    (0..3).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    let first = receive(&mut subscriber);
    let second = receive(&mut subscriber);
    let error = subscriber.receive().unwrap_err();
    assert!(error.to_string().contains("drop one, or raise borrowed"), "{error}");
    drop(first);
    assert_eq!(receive(&mut subscriber).header().sequence, 2);
    drop(subscriber);
    assert_pixels(&second);
}

#[test]
fn slots_keep_their_addresses_and_go_out_in_any_order() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let mut addresses = BTreeSet::new();
    for round in 0..100 {
        let mut slots: Vec<_> = (0..LOANS).map(|_| publisher.loan().unwrap()).collect();
        assert_eq!(publisher.loan().unwrap_err(), LoanError::AllOnLoan(LOANS));
        for slot in &mut slots {
            assert_eq!(slot.address() % 64, 0);
            assert_eq!(slot.as_mut_ptr().addr(), slot.address());
            assert_eq!(slot.len(), FRAME_BYTES);
            addresses.insert(slot.address());
        }
        let order = [round % 3, (round + 2) % 3, (round + 1) % 3];
        let mut slots: Vec<_> = slots.into_iter().map(Some).collect();
        for (place, index) in order.into_iter().enumerate() {
            let slot = slots[index].take().unwrap();
            match place {
                // Dropped: back without being sent.
                2 => drop(slot),
                _ => _ = publisher.publish(slot, &header(7, 2 * round as u64 + place as u64)).unwrap(),
            }
        }
        assert_eq!(drain(&mut subscriber).len(), 2);
    }
    let slots = place.settings.slots_needed(LOANS);
    assert!(addresses.len() <= slots, "{} addresses, {slots} slots", addresses.len());
}

#[test]
fn a_consumer_reads_the_very_memory_that_the_driver_wrote() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    for sequence in 0..20 {
        let slot = publisher.loan().unwrap();
        let written = behind(slot.address());
        publisher.publish(slot, &header(7, sequence)).unwrap();
        let frame = receive(&mut subscriber);
        assert_eq!(behind(frame.pixels().as_ptr().addr()), written);
        assert!(written.0.contains(&place.settings.prefix), "{}", written.0);
    }
}

#[test]
fn pixels_end_with_the_last_pixel() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let narrow = with(header(7, 0), |it| it.width = WIDTH - 10);
    publisher.publish(publisher.loan().unwrap(), &narrow).unwrap();
    assert_eq!(receive(&mut subscriber).pixels().len(), FRAME_BYTES - 10);
}

#[test]
fn rows_leave_out_what_lies_between_them() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let wide = PixelFormat::Mono16;
    for (width, height, stride, format) in [
        (WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8),
        (WIDTH - 10, HEIGHT, WIDTH, PixelFormat::Mono8),
        (5, HEIGHT, 12, wide),
        (1, 1, WIDTH, wide),
    ] {
        let mut slot = publisher.loan().unwrap();
        slot.pixels_mut().iter_mut().enumerate().for_each(|(index, byte)| *byte = pixel(7, index));
        publisher.publish(slot, &FrameHeader::new(width, height, stride, format)).unwrap();
        let frame = receive(&mut subscriber);
        let row_bytes = width as usize * format.bytes_per_pixel();
        let rows =
            (0..height as usize).map(|row| (0..row_bytes).map(move |x| pixel(7, row * stride as usize + x)));
        assert_eq!(frame.rows().len(), height as usize);
        assert!(
            frame.rows().map(<[u8]>::to_vec).eq(rows.map(Iterator::collect::<Vec<_>>)),
            "{width}x{height}"
        );
    }
}

#[test]
fn a_header_that_does_not_describe_its_frame_is_not_published() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let larger = with(header(7, 0), |it| it.height = HEIGHT + 1);
    let error = publisher.publish(publisher.loan().unwrap(), &larger).unwrap_err();
    assert!(error.to_string().contains("576 bytes does not fit in a payload of 512 bytes"), "{error}");
    assert!(subscriber.receive().unwrap().is_none());
}

#[test]
fn the_memory_told_is_the_memory_taken() {
    let place = Place::new();
    let frame_bytes = 752 * 480;
    let _publisher = Publisher::create(&place.settings, CAMERA, frame_bytes, LOANS).unwrap();
    let taken: u64 = place.shared_memory().iter().map(|(_, bytes)| bytes).sum();
    let told = place.settings.shared_memory_needed(frame_bytes, LOANS);
    assert_eq!(place.settings.slots_needed(LOANS), 2 * (4 + 2) + 3);
    assert!(taken <= told && told < taken + (2 << 20), "told {told}, taken {taken}");
}

#[test]
fn everything_may_go_to_another_thread() {
    fn assert_send<T: Send>() {}
    assert_send::<uvcam_shm_ipc::Publisher>();
    assert_send::<uvcam_shm_ipc::Slot>();
    assert_send::<uvcam_shm_ipc::Subscriber>();
    assert_send::<uvcam_shm_ipc::Frame>();
    assert_send::<uvcam_shm_ipc::Mask>();
    // What was received may be read by several.
    fn assert_sync<T: Sync>() {}
    assert_sync::<uvcam_shm_ipc::Frame>();
    assert_sync::<uvcam_shm_ipc::Mask>();
}

#[test]
fn settings_beyond_their_limits_are_refused() {
    let place = Place::new();
    let refusal = |settings: Settings| {
        Publisher::create(&settings, CAMERA, FRAME_BYTES, LOANS).unwrap_err().to_string()
    };
    let good = &place.settings;
    assert!(
        refusal(with(good.clone(), |it| it.max_subscribers = 0)).contains("max_subscribers = 0: use 1 to 64")
    );
    assert!(refusal(with(good.clone(), |it| it.buffer = 257)).contains("buffer = 257: use 1 to 256"));
    assert!(refusal(with(good.clone(), |it| it.borrowed = 65)).contains("borrowed = 65: use 1 to 64"));
    assert!(refusal(with(good.clone(), |it| it.prefix = "a/b".into())).contains("prefix = \"a/b\""));
    assert!(
        refusal(with(good.clone(), |it| it.root_path = "ipc".into()))
            .contains("root_path = ipc: use an absolute path")
    );
    for path in ["/tmp/\u{17e}lu\u{165}", "/tmp/a*b"] {
        let message = refusal(with(good.clone(), |it| it.root_path = path.into()));
        let allowed = "use only ASCII letters, digits and signs other than < > \" | ? * in root_path";
        assert_eq!(message, format!("root_path = {path}: {allowed}"));
    }
    let longest = format!("/{}", "x".repeat(60 - good.prefix.len()));
    let longest = with(good.clone(), |it| it.root_path = longest.into());
    assert!(refusal(longest.clone()).contains("at most 60 bytes"));
    assert_eq!(longest.validate().unwrap_err().to_string(), refusal(longest));
    assert!(good.validate().is_ok() && !good.root_path.exists(), "nothing was made");
}

#[test]
fn the_longest_root_path_and_camera_name_work() {
    let mut place = Place::new();
    let begin = format!("{}/", place.folder.path().display());
    let rest = "x".repeat(60 - place.settings.prefix.len() - begin.len());
    place.settings.root_path = format!("{begin}{rest}").into();
    let camera = "c".repeat(64);
    let mut publisher = Publisher::create(&place.settings, &camera, FRAME_BYTES, LOANS).unwrap();
    let mut subscriber = place.subscriber_of(&camera).unwrap();
    // To sleep takes a socket, of all files the one with the shortest limit.
    assert!(!subscriber.wait(Duration::from_millis(1)).unwrap());
    publish(&mut publisher, 7, 0);
    assert_pixels(&receive(&mut subscriber));
}

#[test]
fn camera_names_that_cannot_be_are_refused() {
    let place = Place::new();
    for name in ["", "a/b", "left camera", "..", &"x".repeat(65)] {
        let error = place.subscriber_of(name).unwrap_err();
        assert!(error.to_string().contains(&format!("camera name \"{name}\"")), "{error}");
    }
}

#[test]
fn memory_that_is_not_there_is_refused_before_it_is_touched() {
    let place = Place::new();
    let error = Publisher::create(&place.settings, CAMERA, 1 << 50, LOANS).unwrap_err().to_string();
    assert!(error.contains("/dev/shm has") && error.contains("MB (15 slots): enlarge /dev/shm"), "{error}");
}
