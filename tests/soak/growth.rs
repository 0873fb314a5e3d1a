//! Three cameras, six consumers, and memory that does not grow.

use std::time::{Duration, Instant};

use uvcam_tests::{Process, Stage, simulated, stderr, wait_until};

const SETTLED: Duration = Duration::from_secs(5);

#[test]
fn three_cameras_with_two_consumers_each_lose_nothing_and_do_not_grow() {
    let cameras = ["left", "right", "back"];
    let stage = Stage::new(&cameras.map(|name| simulated(name, "{camera}.png", "")).concat());
    let [mask, ..] = cameras.map(|name| stage.write_mask(&format!("{name}.png"), (752, 480), 60));
    let mask_file = stage.file("left.png").to_string_lossy().into_owned();
    let watch = |camera: &&str| stage.watch(&[camera, "--mask", &mask_file]);
    let consumers: Vec<Process> = cameras.iter().chain(&cameras).map(watch).collect();
    let driver = stage.driver();
    for camera in cameras {
        let mut subscriber = stage.subscriber(camera);
        wait_until("the camera streams", || subscriber.receive().unwrap().is_some());
    }

    let run = Duration::from_secs(crate::seconds());
    let start = Instant::now();
    // Time passes here because it is what is tested.
    std::thread::sleep(SETTLED);
    let settled_kib = driver.resident_kib();
    std::thread::sleep(run.saturating_sub(start.elapsed()));
    let grown_kib = driver.resident_kib().saturating_sub(settled_kib);
    // One frame of 752 x 480 px has 353 KiB: less than that is the noise of page accounting.
    assert!(grown_kib < 353, "resident memory grew by {grown_kib} KiB over {settled_kib} KiB");

    for consumer in consumers {
        consumer.signal(rustix::process::Signal::INT);
        let report = consumer.json();
        assert_eq!(report["lost"], 0, "{report}");
        assert_eq!(report["epochs"], 1, "{report}");
        assert_eq!(report["masked_nonzero"], 0, "{report}");
        assert_eq!(report["mask_id"], mask.id().to_string(), "{report}");
        let expected = run.as_secs_f64() * 60.0;
        assert!(report["frames"].as_f64().unwrap() > 0.98 * expected, "{report}");
    }
    let output = driver.stop();
    assert_eq!(stderr(&output).matches(" 0 lost (0 of them incomplete), no free slot 0 times").count(), 3);
}
