//! The main process is killed, and nothing flies without it.

use uvcam_shm_ipc::monotonic_ns;

use super::*;

/// Longest time that frames may go out with nobody to look after their process.
const UNSUPERVISED_NS: u64 = 1_000_000_000;
/// Drivers that are killed while they start.
const STARTS: u64 = 20;

#[test]
fn nothing_outlives_a_driver_that_is_killed_and_the_next_one_flies() {
    let stage = three_cameras("");
    let mut victim = stage.subscriber(VICTIM);
    let driver = stage.driver();
    let first = next_frame(&mut victim).header().epoch;
    let processes = CAMERAS.map(|camera| process_of(&driver, camera).unwrap());
    // One of them would hear of nothing.
    signal(processes[1], Signal::STOP);
    let killed_ns = monotonic_ns();
    driver.kill();
    wait_until("the end of all processes", || !processes.iter().any(|id| lives(*id)));
    let stamps: Vec<u64> = std::iter::from_fn(|| victim.receive().unwrap())
        .map(|frame| frame.header().arrival_monotonic_ns)
        .collect();
    assert!(
        stamps.iter().all(|stamp| *stamp < killed_ns + UNSUPERVISED_NS),
        "killed at {killed_ns}: {stamps:?}"
    );

    let driver = stage.driver();
    for camera in CAMERAS {
        next_frame(&mut stage.subscriber(camera));
    }
    assert!(next_frame(&mut victim).header().epoch > first);
    assert_eq!(driver.stop().status.code(), Some(0));
}

#[test]
fn a_driver_that_is_killed_while_it_starts_leaves_no_process_whenever_that_is() {
    let stage = three_cameras("");
    let file = stage.file("uvcam.toml").display().to_string();
    let processes = || {
        let all = fs::read_dir("/proc").unwrap().flatten();
        let lines = all.map(|process| fs::read_to_string(process.path().join("cmdline")).unwrap_or_default());
        lines.filter(|line| line.contains(&file)).collect::<Vec<_>>()
    };
    let mut dice = Dice::new();
    for _ in 0..STARTS {
        let driver = stage.driver();
        wait_until("the first process of a camera", || !children(driver.id()).is_empty());
        std::thread::sleep(Duration::from_millis(dice.roll(40)));
        assert!(!processes().is_empty());
        driver.kill();
        wait_until("the end of all processes", || processes().is_empty());
    }
    let driver = stage.driver();
    CAMERAS.iter().for_each(|camera| _ = next_frame(&mut stage.subscriber(camera)));
    assert_eq!(driver.stop().status.code(), Some(0));
}
