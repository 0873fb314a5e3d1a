#![doc = include_str!("../README.md")]
// Whoever emulates a camera tests something with it: what cannot be done ends the test.
#![allow(clippy::unwrap_used)]

pub mod gige_vision;
pub mod scene;
pub mod usb;
pub mod usb3_vision;
pub mod uvc;

/// Waits until `condition` holds; it must within 20 s.
fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    const PATIENCE: std::time::Duration = std::time::Duration::from_secs(20);
    let start = std::time::Instant::now();
    while !condition() {
        assert!(start.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}
