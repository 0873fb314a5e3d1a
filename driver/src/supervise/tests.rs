//! A supervisor, its camera by script, and time that a test lets pass: a line of a journal for each thing that happened.

use std::sync::atomic::Ordering;
use std::sync::mpsc::Sender;

use super::*;
use crate::config::MaskChoice;
use script::{Ending, Opening, Rig, task};

mod script;

/// A device that is there and fails at once.
const FAILING: Opening = Opening::Device { serial: "A", frames: 0, ending: Ending::AtConfigure };
/// One that delivers a frame, and is gone.
const FLEETING: Opening = Opening::Device { serial: "A", frames: 1, ending: Ending::Gone };

const FAILED: &str = "waiting: camera A failed while configuring: by script";
const GONE: &str = "waiting: camera A disconnected while streaming; check cable and power";
const ABSENT: &str = "waiting: simulated camera \"A\" is not connected; found: nothing; check the cable and the serial (uvcam list)";

#[test]
fn a_camera_is_opened_configured_and_flown_until_the_driver_stops() {
    let rig = Rig::new([Opening::Device { serial: "A", frames: 3, ending: Ending::DriverStops }]);
    let counters = rig.counters.clone();
    let journal = rig.run();
    assert_eq!(journal, ["open A", "configure A: 1000 us", "start A", "streaming A", "stop A", "close A"]);
    assert_eq!(counters.published.load(Ordering::Relaxed), 3);
    assert_eq!(counters.epochs.load(Ordering::Relaxed), 1);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 0);
}

#[test]
fn another_device_is_not_flown_in_the_place_of_the_first() {
    let other = Opening::Device { serial: "B", frames: 1, ending: Ending::Gone };
    let rig = Rig::new([FLEETING, other, FLEETING]);
    let counters = rig.counters.clone();
    let journal = rig.run();
    let lines = without_pauses(&journal);
    let replaced = "waiting: camera scripted \"A\" was opened first, and at its place is scripted \"B\", which is not flown under its \
                    name and mask; connect scripted \"A\" again, or restart the driver to fly scripted \"B\"";
    let flown = ["open A", "configure A: 1000 us", "start A", "streaming A", GONE];
    assert_eq!(lines, [&flown[..], &["open B", "close B", replaced], &flown[..]].concat());
    assert_eq!(counters.published.load(Ordering::Relaxed), 2, "none of B");
}

#[test]
fn a_camera_that_fails_is_tried_again_at_growing_distance() {
    let rig = Rig::new([FAILING; 8]);
    let counters = rig.counters.clone();
    let journal = rig.run();
    assert_eq!(pauses(&journal), [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 8);
    assert_eq!(journal.iter().filter(|line| *line == FAILED).count(), 8, "each is told");
}

#[test]
fn an_absent_camera_is_looked_for_ten_times_a_second_and_is_no_failure() {
    let rig = Rig::new([FAILING, FAILING, Opening::Absent, Opening::Absent, Opening::Absent]);
    let counters = rig.counters.clone();
    let journal = rig.run();
    assert_eq!(journal.iter().filter(|line| *line == ABSENT).count(), 3);
    assert_eq!(pauses(&journal), [100, 200, 100, 100, 100]);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 2);
}

#[test]
fn a_camera_that_was_absent_starts_with_a_clean_record() {
    let journal = Rig::new([FAILING, FAILING, Opening::Absent, Opening::Absent, FAILING, FAILING]).run();
    assert_eq!(pauses(&journal), [100, 200, 100, 100, 100, 200]);
}

#[test]
fn a_camera_that_has_worked_starts_with_a_clean_record() {
    let journal = Rig::new([FAILING, FAILING, FAILING, FLEETING, FAILING]).run();
    assert_eq!(pauses(&journal), [100, 200, 400, 100, 200]);
}

#[test]
fn what_an_attempt_takes_counts_as_its_pause() {
    let slow = Opening::Slow { seconds: 3 };
    let journal = Rig::new([slow, slow, slow, slow, slow, slow, slow]).run();
    // Of 0.1, 0.2, 0.4, 0.8, 1.6, 3.2 and 5 s from start to start.
    assert_eq!(pauses(&journal), [100, 100, 100, 100, 100, 200, 2000]);
}

#[test]
fn a_camera_without_a_mask_stays_closed_until_one_comes() {
    let mut rig = Rig::new([FLEETING]);
    rig.mask = MaskChoice::File("/nowhere/left.png".into());
    rig.on("refused: mask refused", |commands| send(commands, Command::Mask(None)));
    let journal = rig.run();
    assert!(journal[0].contains("mask refused: cannot read `/nowhere/left.png`"), "{journal:?}");
    assert_eq!(journal[1], "open A", "{journal:?}");
}

#[test]
fn lit_frames_are_collected_while_the_camera_is_closed() {
    let device = Opening::Device { serial: "A", frames: 9, ending: Ending::DriverStops };
    let mut rig = Rig::new([device, Opening::Absent, device]);
    rig.mask = MaskChoice::File("/nowhere/left.png".into());
    rig.on("refused: mask refused", |commands| {
        send(commands, Command::Generate(task()));
        send(commands, Command::Generate(task()));
        send(commands, Command::Mask(None));
    });
    let lines = rig.run().split_off(1);
    let lit = [
        "open A",
        "configure A: 5000 us",
        "start A",
        "stop A",
        "stop A",
        "configure A: 1000 us",
        "done: light of A",
        "close A",
    ];
    let absent = "done: simulated camera \"A\" is not connected; found: nothing; check the cable and the serial (uvcam list)";
    assert_eq!(lines[..9], [&lit[..], &[absent]].concat());
    assert_eq!(lines[9..12], ["open A", "configure A: 1000 us", "start A"], "and then it flies");
}

#[test]
fn lit_frames_that_find_no_memory_are_told_to_whoever_waits() {
    let mut rig = Rig::new([Opening::Device { serial: "A", frames: 9, ending: Ending::DriverStops }]);
    rig.mask = MaskChoice::File("/nowhere/left.png".into());
    rig.max_subscribers = 0;
    rig.on("refused: mask refused", |commands| {
        send(commands, Command::Generate(task()));
        send(commands, Command::Mask(None));
    });
    let lines = rig.run().split_off(1);
    let told =
        ["open A", "stop A", "configure A: 1000 us", "done: max_subscribers = 0: use 1 to 64", "close A"];
    assert_eq!(lines[..5], told);
}

#[test]
fn lit_frames_interrupt_a_stream_which_then_goes_on() {
    let mut rig = Rig::new([Opening::Device { serial: "A", frames: 5, ending: Ending::DriverStops }]);
    rig.on("streaming A", |commands| send(commands, Command::Generate(task())));
    let counters = rig.counters.clone();
    let lines = rig.run();
    let told = lines.iter().filter(|line| line.contains(": ") || *line == "generating");
    assert_eq!(
        told.collect::<Vec<_>>(),
        [
            "configure A: 1000 us",
            "generating",
            "configure A: 5000 us",
            "configure A: 1000 us",
            "done: light of A",
            "configure A: 1000 us",
        ]
    );
    assert_eq!(lines.iter().filter(|line| *line == "streaming A").count(), 2);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 0);
}

#[test]
fn a_camera_that_does_not_take_its_flight_settings_back_is_told_and_not_flown() {
    let unwilling = Opening::Device { serial: "A", frames: 5, ending: Ending::AtThirdConfigure };
    let mut rig = Rig::new([unwilling]);
    rig.on("streaming A", |commands| send(commands, Command::Generate(task())));
    let counters = rig.counters.clone();
    let lines = rig.run();
    let done = "done: flight settings not restored, nothing is published: camera A failed while configuring: by script";
    assert!(lines.contains(&done.to_owned()), "{lines:?}");
    let after = lines.iter().skip_while(|line| *line != done).skip(1);
    assert_eq!(after.take(2).collect::<Vec<_>>(), ["close A", FAILED]);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 1);
}

#[test]
fn a_panic_ends_an_attempt_as_a_failure_does() {
    let broken = Opening::Device { serial: "A", frames: 0, ending: Ending::Panics };
    let rig = Rig::new([broken, broken, broken, FLEETING]);
    let counters = rig.counters.clone();
    let journal = rig.run();
    assert_eq!(pauses(&journal), [100, 200, 400, 100]);
    assert_eq!(counters.failures.load(Ordering::Relaxed), 4);
    assert_eq!(counters.published.load(Ordering::Relaxed), 1, "of the last one");
    let attempt = ["open A", "configure A: 1000 us", "start A", "close A"];
    assert_eq!(journal[..4], attempt);
    assert!(journal[4].starts_with("waiting: ") && journal[4].contains("by script"), "{}", journal[4]);
}

#[test]
fn no_third_device_is_opened_while_two_are_still_being_closed() {
    let mut rig = Rig::new([FAILING, FAILING, FAILING]);
    let closed = rig.hold_cameras_open();
    // Two are on their way out after 100 and 200 ms; the third waits.
    rig.after_pauses_of(1000, move |opened| {
        assert_eq!(opened, 2);
        let _ = closed.send(());
    });
    let journal = rig.run();
    assert_eq!(journal.iter().filter(|line| *line == "open A").count(), 3, "{journal:?}");
}

#[test]
fn the_end_of_the_driver_cuts_a_pause_short() {
    let mut rig = Rig::new([FAILING; 8]);
    let stop = rig.stop.clone();
    rig.after_pauses_of(3300, move |_| stop.store(true, Ordering::Relaxed));
    let journal = rig.run();
    // 100, 200, 400, 800, 1600 and 200 of 3200 ms.
    assert_eq!(pauses(&journal), [100, 200, 400, 800, 1600, 200]);
    assert_eq!(journal.iter().filter(|line| *line == "open A").count(), 6);
}

#[test]
fn the_end_of_the_driver_ends_the_wait_for_a_mask() {
    let mut rig = Rig::new([FLEETING]);
    rig.mask = MaskChoice::File("/nowhere/left.png".into());
    let stop = rig.stop.clone();
    rig.on("refused: mask refused", move |_| stop.store(true, Ordering::Relaxed));
    assert_eq!(rig.run().len(), 1, "refused, and nothing opened");
}

#[test]
fn the_end_of_the_driver_ends_the_wait_for_room() {
    let mut rig = Rig::new([FAILING, FAILING, FAILING]);
    let closed = rig.hold_cameras_open();
    let stop = rig.stop.clone();
    rig.after_pauses_of(1000, move |opened| {
        assert_eq!(opened, 2);
        stop.store(true, Ordering::Relaxed);
        let _ = closed.send(());
    });
    assert_eq!(rig.run().iter().filter(|line| *line == "open A").count(), 2);
}

#[test]
fn the_present_is_the_systems_and_sleep_lets_it_pass() {
    let before = SystemClock.now();
    SystemClock.sleep(Duration::from_millis(1));
    assert!(SystemClock.now() - before >= Duration::from_millis(1));
}

fn send(commands: &Sender<Command>, command: Command) {
    commands.send(command).unwrap();
}

fn without_pauses(journal: &[String]) -> Vec<&str> {
    let is_told = |line: &&str| !line.starts_with("pause ") && !line.starts_with("close A");
    journal.iter().map(String::as_str).filter(is_told).collect()
}

/// Milliseconds between two attempts.
fn pauses(journal: &[String]) -> Vec<u64> {
    let attempts = journal.split(|line| line.starts_with("waiting: ")).skip(1);
    let naps = |lines: &[String]| {
        lines.iter().filter_map(|line| line.strip_prefix("pause ")?.parse::<u64>().ok()).sum()
    };
    let pauses = attempts.map(naps);
    pauses.collect()
}
