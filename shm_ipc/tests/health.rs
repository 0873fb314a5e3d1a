//! The health of a camera, as its readers see it.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use iceoryx2::prelude::*;
use support::child::{Role, role, say, told_to_go_on};
use support::*;
use uvcam_shm_ipc::health::{Cause, Health, HealthPublisher, HealthReader, State, health_service_name};
use uvcam_shm_ipc::{Footing, IpcErrorKind};

fn publisher(place: &Place) -> HealthPublisher {
    HealthPublisher::create(&place.settings, CAMERA).unwrap()
}

fn reader(place: &Place) -> HealthReader {
    HealthReader::open(&place.settings, CAMERA).unwrap().expect("a driver runs")
}

fn published(count: u64) -> Health {
    with(Health::new(), |it| (it.published, it.state) = (count, State::Streaming as u32))
}

#[test]
fn a_late_reader_gets_the_newest_record_and_each_record_once() {
    let place = Place::new();
    let publisher = publisher(&place);
    for count in 0..10 {
        publisher.publish(&published(count)).unwrap();
    }
    let (mut early, mut late) = (reader(&place), reader(&place));
    publisher.serve_newcomers().unwrap();
    assert_eq!(late.newest().unwrap().map(|health| health.published), Some(9));
    assert!(late.newest().unwrap().is_none());

    // A reader that does not look has only the newest waiting.
    publisher.publish(&published(10)).unwrap();
    publisher.publish(&published(11)).unwrap();
    for reader in [&mut early, &mut late] {
        let health = reader.wait(PATIENCE).unwrap().unwrap();
        assert_eq!(
            (health.published, health.state(), health.cause()),
            (11, Ok(State::Streaming), Ok(Cause::None))
        );
        assert!(reader.newest().unwrap().is_none());
    }
}

#[test]
fn without_a_driver_there_is_nothing_to_read() {
    let place = Place::new();
    assert!(HealthReader::open(&place.settings, CAMERA).unwrap().is_none());
    let publisher = publisher(&place);
    let mut reader = reader(&place);
    drop(publisher);
    assert!(HealthReader::open(&place.settings, CAMERA).unwrap().is_none());
    assert!(reader.newest().unwrap().is_none());
}

#[test]
fn one_driver_tells_of_a_camera() {
    let place = Place::new();
    let _first = publisher(&place);
    let second = HealthPublisher::create(&place.settings, CAMERA);
    let kind = second.map(drop).map_err(|error| error.kind());
    assert_eq!(kind, Err(IpcErrorKind::AlreadyPublishing));
}

#[test]
fn a_reader_stays_while_one_driver_is_killed_and_the_next_comes() {
    let place = Place::new();
    let mut driver = Role::start("driver", &place.settings);
    driver.expect("published");
    let mut reader = reader(&place);
    driver.go_on();
    driver.expect("served");
    assert_eq!(reader.wait(PATIENCE).unwrap().unwrap().published, 1);
    driver.kill();
    let next = publisher(&place);
    next.publish(&published(2)).unwrap();
    while reader.wait(PATIENCE).unwrap().unwrap().published != 2 {}
}

/// Waits until the driver's end has told the reader this.
fn hears(reader: &mut HealthReader, publisher: &HealthPublisher, count: u64) {
    wait_until("a record", || {
        publisher.serve_newcomers().unwrap();
        reader.newest().unwrap().is_some_and(|health| health.published == count)
    });
}

#[test]
fn a_reader_lets_go_of_a_driver_that_is_gone_and_follows_the_next_which_makes_the_service_anew() {
    let place = Place::new();
    let first = publisher(&place);
    let mut reader = reader(&place);
    first.publish(&published(1)).unwrap();
    drop(first);
    let mut heard = Vec::new();
    wait_until("that it lets go", || {
        heard.extend(reader.newest().unwrap().map(|health| health.published));
        !reader.is_connected()
    });
    assert_eq!(heard, [1], "what was said last is heard");
    let left = place.shared_memory().into_iter().filter(|(file, _)| !file.ends_with("global_mgmt"));
    assert_eq!(left.collect::<Vec<_>>(), [], "of the service, whose last holder it was");
    let next = publisher(&place);
    next.publish(&published(2)).unwrap();
    hears(&mut reader, &next, 2);
    assert!(reader.is_connected());
}

#[test]
fn a_reader_follows_its_driver_which_makes_removed_files_anew() {
    let place = Place::new();
    let mut driver = Some(publisher(&place));
    let mut reader = reader(&place);
    driver.as_ref().unwrap().publish(&published(1)).unwrap();
    hears(&mut reader, driver.as_ref().unwrap(), 1);
    for (file, _) in place.shared_memory() {
        std::fs::remove_file(format!("/dev/shm/{file}")).unwrap();
    }
    let create = || HealthPublisher::create_at_once(&place.settings, CAMERA);
    Footing::keep(&mut driver, HealthPublisher::footing, create).unwrap();
    let driver = driver.unwrap();
    driver.publish(&published(2)).unwrap();
    hears(&mut reader, &driver, 2);
}

#[test]
fn a_reader_is_told_where_the_next_driver_has_no_place_for_it() {
    let place = Place::new();
    let first = publisher(&place);
    let mut reader = reader(&place);
    drop(first);
    wait_until("that it lets go", || {
        assert_eq!(reader.newest().unwrap(), None);
        !reader.is_connected()
    });
    let _next = publisher(&place);
    let _others: Vec<_> =
        (0..16).map(|_| HealthReader::open(&place.settings, CAMERA).unwrap().unwrap()).collect();
    let mut refusal = None;
    wait_until("the refusal", || {
        refusal = reader.newest().err();
        refusal.is_some()
    });
    assert_eq!(refusal.map(|error| error.kind()), Some(IpcErrorKind::TooManyConsumers));
}

#[test]
fn records_that_lie_are_rejected_and_counted() {
    let place = Place::new();
    let config = place.settings.to_iceoryx2().unwrap();
    let node = NodeBuilder::new().config(&config).create::<ipc_threadsafe::Service>().unwrap();
    let name = ServiceName::new(&health_service_name(CAMERA)).unwrap();
    let service = node.service_builder(&name).publish_subscribe::<Health>().create().unwrap();
    let rogue = service.publisher_builder().create().unwrap();
    let mut reader = reader(&place);
    for lie in [
        with(published(1), |it| it.magic = 0),
        with(published(1), |it| it.state = 99),
        with(published(1), |it| it.frame_rate = f64::INFINITY),
    ] {
        rogue.send_copy(lie).unwrap();
    }
    rogue.send_copy(published(7)).unwrap();
    let read = std::iter::from_fn(|| reader.newest().unwrap()).map(|health| health.published);
    assert_eq!(read.last(), Some(7));
    assert!(reader.rejected() > 0);
}

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    assert_eq!(role, "driver");
    let publisher = HealthPublisher::create(&settings, CAMERA).unwrap();
    publisher.publish(&published(1)).unwrap();
    say("published");
    while told_to_go_on() {
        publisher.serve_newcomers().unwrap();
        say("served");
    }
}
