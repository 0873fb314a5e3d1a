//! Every way to wait for a frame, whatever the driver and the other consumers do.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::sync::mpsc::channel;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use support::child::{Role, publish_on_demand, role, say};
use support::*;
use uvcam_shm_ipc::iceoryx2::prelude::*;
use uvcam_shm_ipc::{IpcErrorKind, Publisher, Subscriber, Wakeup, monotonic_ns, wake_service_name};

const ALL: [Wakeup; 3] = [Wakeup::Futex, Wakeup::Predictive, Wakeup::Event];

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    match role.as_str() {
        "driver" => publish_on_demand(&settings),
        "sleeper" => {
            let mut subscriber = Subscriber::open(&settings, CAMERA).unwrap();
            receive(&mut subscriber);
            say("asleep");
            subscriber.wait(PATIENCE).unwrap();
        }
        unknown => panic!("no role {unknown}"),
    }
}

fn place_for_six() -> Place {
    let mut place = Place::new();
    place.settings = with(place.settings.clone(), |it| it.max_subscribers = 6);
    place
}

fn subscriber(place: &Place, wakeup: Wakeup) -> Subscriber {
    let mut subscriber = place.subscriber();
    subscriber.set_wakeup(wakeup);
    subscriber
}

/// Sends a frame whose header tells this period.
fn publish_at_period(publisher: &mut Publisher, sequence: u64, frame_period_ns: u64) {
    let slot = publisher.loan().unwrap();
    publisher.publish(slot, &with(header(7, sequence), |it| it.frame_period_ns = frame_period_ns)).unwrap();
}

/// Processor time that this thread has used.
fn cpu_time() -> Duration {
    let used = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(used.tv_sec as u64, used.tv_nsec as u32)
}

#[test]
fn six_sleepers_get_every_frame() {
    for wakeup in ALL {
        let place = place_for_six();
        let mut publisher = place.publisher();
        let (received, told) = channel();
        std::thread::scope(|scope| {
            for consumer in 0..6 {
                let (mut subscriber, received) = (subscriber(&place, wakeup), received.clone());
                scope.spawn(move || {
                    for _ in 0..100 {
                        received.send((receive(&mut subscriber).header().sequence, consumer)).unwrap();
                    }
                });
            }
            // One that meets a file which another is just making looks again a little later.
            wait_until("all consumers", || publisher.subscribers() == 6);
            for sequence in 0..100 {
                publish_at_period(&mut publisher, sequence, 2_000_000);
                let mut who: Vec<_> = (0..6).map(|_| told.recv_timeout(PATIENCE).unwrap()).collect();
                who.sort();
                assert!(who.into_iter().eq((0..6).map(|consumer| (sequence, consumer))), "{wakeup:?}");
            }
        });
    }
}

#[test]
fn a_driver_that_dies_while_consumers_sleep_wakes_them_when_it_is_back() {
    for wakeup in ALL {
        let place = Place::new();
        let (received, told) = channel();
        std::thread::scope(|scope| {
            let mut subscriber = subscriber(&place, wakeup);
            scope.spawn(move || {
                while let Ok(()) = received.send(receive(&mut subscriber).header().sequence) {
                    if subscriber.epochs() == 3 {
                        break;
                    }
                }
            });
            for _ in 0..3 {
                let mut driver = Role::start("driver", &place.settings);
                driver.expect("ready");
                driver.go_on();
                assert_eq!(told.recv_timeout(PATIENCE), Ok(0), "{wakeup:?}");
                driver.kill();
            }
        });
    }
}

#[test]
fn a_driver_that_stops_cleanly_wakes_sleepers_of_its_old_page_when_it_is_back() {
    let place = Place::new();
    let mut subscriber = subscriber(&place, Wakeup::Futex);
    let (received, told) = channel();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            (0..4).for_each(|_| received.send(receive(&mut subscriber).header().sequence).unwrap());
        });
        for _ in 0..2 {
            let mut publisher = place.publisher();
            wait_until("the consumer", || publisher.subscribers() == 1);
            for sequence in 0..2 {
                publish(&mut publisher, uvcam_shm_ipc::realtime_ns(), sequence);
                assert_eq!(told.recv_timeout(PATIENCE), Ok(sequence));
            }
        }
    });
}

#[test]
fn a_sleeper_that_is_killed_takes_no_wake_up_from_the_others() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let sleeper = Role::start("sleeper", &place.settings);
    wait_until("the sleeper", || publisher.subscribers() == 1);
    publish(&mut publisher, 7, 0);
    sleeper.expect("asleep");
    sleeper.kill();
    let mut subscriber = subscriber(&place, Wakeup::Futex);
    let (received, told) = channel();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            (0..20).for_each(|_| received.send(receive(&mut subscriber).header().sequence).unwrap());
        });
        for sequence in 1..21 {
            publish(&mut publisher, 7, sequence);
            assert_eq!(told.recv_timeout(PATIENCE), Ok(sequence));
        }
    });
}

#[test]
fn a_rate_that_changes_loses_no_frame() {
    for wakeup in ALL {
        let place = Place::new();
        let mut publisher = place.publisher();
        let mut subscriber = subscriber(&place, wakeup);
        let (received, told) = channel();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                (0..80).for_each(|_| received.send(receive(&mut subscriber).header().sequence).unwrap());
            });
            let mut due_ns = monotonic_ns();
            for sequence in 0..80 {
                // What the header says changes after the rate does, as it would where a camera is set anew.
                let period_ns = if sequence < 40 { 5_000_000 } else { 12_000_000 };
                let told_ns = if sequence < 50 { 5_000_000 } else { 12_000_000 };
                due_ns += period_ns;
                std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(monotonic_ns())));
                publish_at_period(&mut publisher, sequence, told_ns);
                assert_eq!(told.recv_timeout(PATIENCE), Ok(sequence), "{wakeup:?}");
            }
        });
    }
}

#[test]
fn who_holds_as_many_frames_as_it_may_is_told_so_and_loses_none() {
    for wakeup in ALL {
        let place = Place::new();
        let mut publisher = place.publisher();
        let mut subscriber = subscriber(&place, wakeup);
        let (received, told) = channel();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let mut held: Vec<_> = (0..20)
                    .map(|_| receive(&mut subscriber))
                    .inspect(|_| received.send(()).unwrap())
                    .skip(18)
                    .collect();
                assert_eq!(held.len(), place.settings.borrowed);
                assert!(subscriber.wait(PATIENCE).unwrap());
                assert_eq!(subscriber.receive().unwrap_err().kind(), IpcErrorKind::TooManyHeld, "{wakeup:?}");
                held.pop();
                let frame = subscriber.receive().unwrap().unwrap();
                assert_eq!((frame.header().sequence, frame.lost_before()), (20, 0), "{wakeup:?}");
                received.send(()).unwrap();
            });
            let mut due_ns = monotonic_ns();
            for sequence in 0..21 {
                due_ns += 5_000_000;
                std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(monotonic_ns())));
                publish_at_period(&mut publisher, sequence, 5_000_000);
                told.recv_timeout(PATIENCE).unwrap();
            }
        });
    }
}

#[test]
fn frames_that_stop_leave_sleepers_asleep() {
    for wakeup in ALL {
        let place = Place::new();
        let mut publisher = place.publisher();
        let mut subscriber = subscriber(&place, wakeup);
        for sequence in 0..20 {
            publish_at_period(&mut publisher, sequence, 5_000_000);
            receive(&mut subscriber);
        }
        let before = cpu_time();
        assert!(!subscriber.wait(Duration::from_secs(2)).unwrap(), "{wakeup:?}: no frame was sent");
        // Processor time, not time: 2 % of what passed; to watch all the while would take all of it.
        let used = cpu_time() - before;
        assert!(used < Duration::from_millis(40), "{wakeup:?}: {used:?} of 2 s");
        publish_at_period(&mut publisher, 20, 5_000_000);
        assert_eq!(receive(&mut subscriber).header().sequence, 20);
    }
}

#[test]
fn a_wait_set_is_woken_by_the_event_of_the_camera() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let mut subscriber = place.subscriber();
    let config = place.settings.to_iceoryx2().unwrap();
    let node = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
    let name = ServiceName::new(&wake_service_name(CAMERA)).unwrap();
    let event = node.service_builder(&name).event().open().unwrap();
    let listener = event.listener_builder().create().unwrap();
    let wait_set = WaitSetBuilder::new().create::<ipc::Service>().unwrap();
    let guard = wait_set.attach_notification(&listener).unwrap();
    let mine = WaitSetAttachmentId::from_guard(&guard);
    for sequence in 0..20 {
        publish(&mut publisher, 7, sequence);
        let mut frames = Vec::new();
        wait_set
            .wait_and_process_once_with_timeout(
                |id| {
                    assert!(id == mine);
                    listener.try_wait(|_| ()).unwrap();
                    frames.extend(drain(&mut subscriber));
                    CallbackProgression::Continue
                },
                PATIENCE,
            )
            .unwrap();
        assert_eq!(frames, [(sequence, 0)]);
    }
}

#[test]
fn the_shortest_wait_ends() {
    let place = Place::new();
    let _driver = place.publisher();
    for wakeup in ALL {
        let mut subscriber = Subscriber::open(&place.settings, CAMERA).unwrap();
        subscriber.set_wakeup(wakeup);
        let (over, ends) = channel();
        std::thread::spawn(move || {
            // As short as what is left of a longer wait.
            for timeout_ns in [1_000_000, 999, 500, 1, 0] {
                subscriber.wait(Duration::from_nanos(timeout_ns)).unwrap();
            }
            over.send(()).unwrap();
        });
        assert!(ends.recv_timeout(PATIENCE).is_ok(), "{wakeup:?}");
    }
}
