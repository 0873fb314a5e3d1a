//! Drivers and consumers that come, go, hang, and are killed.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::cell::Cell;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, setrlimit};
use support::child::{Role, publish_on_demand, role, say, told_to_go_on};
use support::*;
use uvcam_shm_ipc::{IpcErrorKind, Publisher, Settings, Subscriber, cleanup_dead_nodes};

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    match role.as_str() {
        "driver" => publish_on_demand(&settings),
        "consumer" => hold_frames(&settings),
        "confined" => run_out_of_addresses(&settings),
        unknown => panic!("no role {unknown}"),
    }
}

/// A consumer that sleeps until frames come, holds as many as it may, and does not let go.
fn hold_frames(settings: &Settings) {
    let mut subscriber = Subscriber::open(settings, CAMERA).unwrap();
    say("ready");
    let held: Vec<_> = (0..settings.borrowed).map(|_| receive(&mut subscriber)).collect();
    say("holding");
    while told_to_go_on() {
        held.iter().for_each(assert_pixels);
        say("holding");
    }
}

/// A driver whose limits do not let it map its memory.
fn run_out_of_addresses(settings: &Settings) {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let mapped = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.strip_suffix("kB"));
    let mapped_kb: u64 = mapped.unwrap().trim().parse().unwrap();
    let room = Some((mapped_kb << 10) + (16 << 20));
    setrlimit(Resource::As, Rlimit { current: room, maximum: room }).unwrap();
    let error = Publisher::create(settings, CAMERA, 2 << 20, LOANS).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::NotMapped, "{error}");
    say("refused");
}

#[test]
fn memory_that_cannot_be_mapped_is_an_error() {
    let place = Place::new();
    let driver = Role::start("confined", &place.settings);
    driver.expect("refused");
    driver.leave();
}

#[test]
fn consumers_killed_with_frames_in_hand_take_nothing_from_the_driver() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut witness = place.subscriber();
    let sequence = Cell::new(0);
    let publish_next = |publisher: &mut Publisher| {
        publish(publisher, 7, sequence.get());
        sequence.set(sequence.get() + 1);
    };
    publish_next(&mut publisher);
    drain(&mut witness);
    for _ in 0..10 {
        let consumer = Role::start("consumer", &place.settings);
        consumer.expect("ready");
        wait_until("both consumers", || publisher.subscribers() == 2);
        (0..place.settings.borrowed).for_each(|_| publish_next(&mut publisher));
        consumer.expect("holding");
        consumer.kill();
        // As long as nobody cleaned up, the dead one fills its buffer; the driver goes on.
        for _ in 0..50 {
            let slots: Vec<_> = (0..LOANS).map(|_| publisher.loan().unwrap()).collect();
            drop(slots);
            publish_next(&mut publisher);
        }
        cleanup_dead_nodes(&place.settings);
        assert_eq!(publisher.subscribers(), 1);
        publish_next(&mut publisher);
        assert!(drain(&mut witness).iter().any(|(last, _)| *last + 1 == sequence.get()));
    }
    assert_eq!(witness.frames() + witness.lost(), sequence.get());
}

#[test]
fn a_stopped_consumer_holds_nobody_up() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut consumer = Role::start("consumer", &place.settings);
    consumer.expect("ready");
    wait_until("the consumer", || publisher.subscribers() == 1);
    (0..2).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    consumer.expect("holding");
    let pid = Pid::from_raw(consumer.pid() as i32).unwrap();
    kill_process(pid, Signal::STOP).unwrap();
    // More wake-ups than its socket can hold.
    for sequence in 2..2000 {
        assert_eq!(publish(&mut publisher, 7, sequence), 1);
    }
    kill_process(pid, Signal::CONT).unwrap();
    consumer.go_on();
    consumer.expect("holding");
    consumer.leave();
}

#[test]
fn a_killed_driver_comes_back_and_its_consumer_carries_on() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    let mut last_epoch = 0;
    for round in 0..3 {
        let mut driver = Role::start("driver", &place.settings);
        driver.expect("ready");
        for sequence in 0..3 {
            driver.go_on();
            let frame = receive(&mut subscriber);
            assert_pixels(&frame);
            assert_eq!((frame.header().sequence, frame.lost_before()), (sequence, 0));
            assert_eq!(frame.epoch_changed(), round > 0 && sequence == 0);
            assert!(frame.header().epoch > last_epoch || sequence > 0);
            last_epoch = frame.header().epoch;
        }
        driver.kill();
    }
    assert_eq!((subscriber.frames(), subscriber.lost(), subscriber.epochs()), (9, 0, 3));
}

#[test]
fn a_driver_starts_where_another_was_killed_while_it_started() {
    let place = Place::new();
    let services = place.settings.root_path.join("services");
    let publisher = place.publisher();
    let descriptions: Vec<_> = fs::read_dir(&services).unwrap().map(|file| file.unwrap().path()).collect();
    assert_eq!(descriptions.len(), 2);
    drop(publisher);
    // Files as they are until their maker has finished them.
    let half_made = |path: &std::path::Path, mode| {
        fs::write(path, "").unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    };
    descriptions.iter().for_each(|description| half_made(description, 0o600));
    let register = format!("/dev/shm/{}half.dynamic", place.settings.prefix);
    half_made(register.as_ref(), 0o200);
    let mut subscriber = place.subscriber();
    assert!(subscriber.receive().unwrap().is_none());
    let mut publisher = place.publisher();
    meet(&publisher, &mut subscriber);
    publish(&mut publisher, 7, 0);
    assert_pixels(&receive(&mut subscriber));
    assert!(!fs::exists(register).unwrap());
}

#[test]
fn a_frame_of_a_killed_driver_stays_readable() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    let mut driver = Role::start("driver", &place.settings);
    driver.expect("ready");
    driver.go_on();
    let held = receive(&mut subscriber);
    driver.kill();
    let mut publisher = place.publisher();
    publish(&mut publisher, u64::MAX, 0);
    assert!(receive(&mut subscriber).epoch_changed());
    drop(publisher);
    drop(subscriber);
    assert_pixels(&held);
}

#[test]
fn a_driver_that_stops_and_starts_keeps_its_consumer() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    for epoch in 1..4 {
        let mut publisher = place.publisher();
        meet(&publisher, &mut subscriber);
        for sequence in 0..3 {
            publish(&mut publisher, epoch, sequence);
        }
        let frame = receive(&mut subscriber);
        assert_eq!((frame.header().epoch, frame.header().sequence), (epoch, 0));
        drop(publisher);
        // What a driver sent before it stopped is still read.
        assert_eq!(drain(&mut subscriber), [(1, 0), (2, 0)]);
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 3));
}

#[test]
fn what_a_driver_sent_before_it_stopped_waits_for_a_slow_consumer() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    (0..2).for_each(|sequence| _ = publish(&mut publisher, 7, sequence));
    drop(publisher);
    // Longer than a consumer keeps services that nobody is behind: the length of the silence is the point.
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!(drain(&mut subscriber), [(0, 0), (1, 0)]);
}

#[test]
fn a_consumer_may_come_first() {
    let place = Place::new();
    let mut subscriber = place.subscriber();
    assert!(!subscriber.is_connected());
    assert!(!subscriber.wait(Duration::from_millis(50)).unwrap());
    assert!(subscriber.receive().unwrap().is_none());
    let mut publisher = place.publisher();
    meet(&publisher, &mut subscriber);
    publish(&mut publisher, 7, 0);
    assert_pixels(&receive(&mut subscriber));
}

#[test]
fn a_sleeping_consumer_is_woken() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let (received, told) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            (0..20).for_each(|_| received.send(receive(&mut subscriber).header().sequence).unwrap())
        });
        for sequence in 0..20 {
            publish(&mut publisher, 7, sequence);
            assert_eq!(told.recv(), Ok(sequence));
        }
    });
}

#[test]
fn a_consumer_that_the_driver_cannot_connect_to_comes_again() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    // The connection is made by the consumer and as yet unknown to the driver. Here it is as if its maker had not finished it.
    let connections: Vec<_> =
        place.shared_memory().into_iter().filter(|(name, _)| name.ends_with(".connection")).collect();
    let [(connection, _)] = &connections[..] else { panic!("{connections:?}") };
    let unfinished = fs::Permissions::from_mode(0o200);
    fs::set_permissions(format!("/dev/shm/{connection}"), unfinished).unwrap();
    let mut sequence = 0;
    wait_until("a frame", || {
        publish(&mut publisher, 7, sequence);
        sequence += 1;
        subscriber.receive().unwrap().is_some()
    });
    let frames = drain(&mut subscriber).len() as u64;
    (0..3).for_each(|more| _ = publish(&mut publisher, 7, sequence + more));
    assert_eq!((drain(&mut subscriber).len(), subscriber.epochs()), (3, 1), "after {frames}");
}

#[test]
fn a_second_driver_of_one_camera_is_refused() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let error = Publisher::create(&place.settings, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::AlreadyPublishing, "{error}");
    assert!(error.message().contains(&format!("\"{CAMERA}\"")), "{error}");
    Publisher::create(&place.settings, "right", FRAME_BYTES, LOANS).unwrap();
    let mut subscriber = place.subscriber();
    publish(&mut publisher, 7, 0);
    assert_pixels(&receive(&mut subscriber));
}

#[test]
fn consumers_beyond_the_agreed_number_are_refused() {
    let place = Place::new();
    let _publisher = place.publisher();
    let _subscribers = [place.subscriber(), place.subscriber()];
    let error = place.subscriber_of(CAMERA).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::TooManyConsumers, "{error}");
}

#[test]
fn services_of_other_settings_are_refused_while_a_consumer_holds_on() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    publish(&mut publisher, 7, 0);
    let held = receive(&mut subscriber);
    drop(publisher);
    let larger = with(place.settings.clone(), |it| it.buffer = 8);
    let error = Publisher::create(&larger, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::Incompatible, "{error}");
    assert!(error.to_string().contains("stop its consumers"), "{error}");
    assert_pixels(&held);
}

#[test]
fn a_consumer_without_a_driver_makes_room_for_other_settings() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    publish(&mut publisher, 1, 0);
    receive(&mut subscriber);
    drop(publisher);
    let larger = with(place.settings.clone(), |it| it.buffer = 8);
    std::thread::scope(|scope| {
        let consumer = scope.spawn(|| receive(&mut subscriber));
        let mut publisher = Publisher::create(&larger, CAMERA, FRAME_BYTES, LOANS).unwrap();
        wait_until("the consumer", || publisher.subscribers() == 1);
        publish(&mut publisher, 2, 0);
        assert!(consumer.join().unwrap().epoch_changed());
    });
}

#[test]
fn a_consumer_finds_services_that_were_made_anew_behind_its_back() {
    let place = Place::new();
    let mut orphaned = place.publisher();
    let mut subscriber = place.subscriber();
    publish(&mut orphaned, 1, 0);
    receive(&mut subscriber);
    // What a cleaner of temporary files does.
    fs::remove_dir_all(&place.settings.root_path).unwrap();
    for (name, _) in place.shared_memory() {
        fs::remove_file(format!("/dev/shm/{name}")).unwrap();
    }
    let mut publisher = place.publisher();
    meet(&publisher, &mut subscriber);
    publish(&mut publisher, 2, 0);
    assert!(receive(&mut subscriber).epoch_changed());
}

#[test]
fn cleaning_up_does_not_touch_the_living() {
    let place = Place::new();
    let mut driver = Role::start("driver", &place.settings);
    driver.expect("ready");
    let mut subscriber = place.subscriber();
    // Within the process of a living node, and from another one.
    for _ in 0..3 {
        assert_eq!(cleanup_dead_nodes(&place.settings), 0);
    }
    let consumer = Role::start("consumer", &place.settings);
    consumer.expect("ready");
    (0..2).for_each(|_| driver.go_on());
    consumer.expect("holding");
    assert_eq!(
        (receive(&mut subscriber).header().sequence, receive(&mut subscriber).header().sequence),
        (0, 1)
    );
}

#[test]
fn a_configuration_file_in_the_working_folder_is_not_read() {
    let place = Place::new();
    let folder = place.folder.path().join("elsewhere");
    fs::create_dir_all(folder.join("config")).unwrap();
    fs::write(
        folder.join("config/iceoryx2.toml"),
        "[global]\nprefix = \"stray_\"\nroot-path = \"/nowhere\"\n",
    )
    .unwrap();
    let mut driver = Role::start_in("driver", &place.settings, &folder);
    driver.expect("ready");
    let mut subscriber = place.subscriber();
    driver.go_on();
    assert_pixels(&receive(&mut subscriber));
}

#[test]
fn who_leaves_leaves_nothing_behind() {
    let place = Place::new();
    let driver = Role::start("driver", &place.settings);
    driver.expect("ready");
    let subscriber = place.subscriber();
    assert!(place.shared_memory().len() > 1);
    driver.leave();
    drop(subscriber);
    let large: Vec<_> = place.shared_memory().into_iter().filter(|(_, bytes)| *bytes > 4096).collect();
    assert_eq!(large, []);
}
