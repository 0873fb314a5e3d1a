//! What a camera does wrong, and what its consumers and its siblings see of it.
#![allow(clippy::unwrap_used)]

use uvcam_tests::{Stage, simulated, stderr, wait_until};

/// Takes `frames` frames of a camera with these faults, and returns (lost, epochs) as the consumer counted, and what the driver
/// said. A sibling must lose nothing meanwhile.
fn with_faults(faults: &str, frames: u64) -> (u64, u64, String) {
    let faulty = simulated("left", "none", &format!(", faults = [{faults}]"));
    let stage = Stage::new(&(faulty + &simulated("right", "none", "")));
    let (mut left, mut right) = (stage.subscriber("left"), stage.subscriber("right"));
    let driver = stage.driver();
    wait_until("the faulty camera's frames are there", || {
        while left.next().unwrap().is_some() {}
        while right.next().unwrap().is_some() {}
        left.frames() >= frames
    });
    assert_eq!((right.lost(), right.epochs()), (0, 1), "the sibling of a faulty camera");
    assert!(right.frames() > 0);
    (left.lost(), left.epochs(), stderr(&driver.stop()))
}

#[test]
fn lost_frames_are_counted_exactly() {
    let faults =
        "{ kind = \"lost\", at_frame = 20, count = 3 }, { kind = \"lost\", at_frame = 50, count = 1 }";
    let (lost, epochs, said) = with_faults(faults, 100);
    assert_eq!((lost, epochs), (4, 1));
    assert!(said.contains("left: 1") && said.contains(" 4 lost (0 of them incomplete)"), "{said}");
}

#[test]
fn incomplete_frames_are_not_published_and_counted() {
    let (lost, epochs, said) = with_faults("{ kind = \"incomplete\", at_frame = 20, count = 2 }", 60);
    assert_eq!((lost, epochs), (2, 1));
    assert!(said.contains(" 2 lost (2 of them incomplete)"), "{said}");
}

#[test]
fn a_camera_that_falls_silent_is_opened_again() {
    let (_, epochs, said) = with_faults("{ kind = \"freeze\", at_frame = 20, seconds = 1.5 }", 60);
    assert_eq!(epochs, 2);
    assert!(said.contains("left: camera left failed while streaming: no frame for"), "{said}");
}

#[test]
fn an_unplugged_camera_is_opened_again_when_it_is_back() {
    let (_, epochs, said) = with_faults("{ kind = \"unplug\", at_frame = 20, seconds = 0.5 }", 60);
    assert_eq!(epochs, 2);
    assert!(said.contains("left: camera left disconnected while"), "{said}");
}

#[test]
fn a_short_pause_of_the_camera_is_not_taken_for_a_failure() {
    let (lost, epochs, _) = with_faults("{ kind = \"freeze\", at_frame = 20, seconds = 0.4 }", 60);
    assert_eq!((lost, epochs), (0, 1));
}
