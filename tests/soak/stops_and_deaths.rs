//! Three cameras with four consumers each, of which one stops now and then and one dies now and then: the others lose nothing.

use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;
use uvcam_tests::{Process, Stage, simulated, stderr, wait_until};

const CAMERAS: [&str; 3] = ["left", "right", "back"];
/// Every so many seconds a consumer stops, for `STOPPED_S`.
const STOP_EVERY_S: u64 = 10;
const STOPPED_S: u64 = 2;
/// Every so many seconds a consumer dies.
const KILL_EVERY_S: u64 = 5;
/// Frames that a consumer which stops cannot have: those of its stops, less what its buffer holds and the edges.
const LOST_PER_STOP: u64 = STOPPED_S * 60 - 20;

#[test]
fn consumers_that_stop_and_die_cost_the_others_nothing() {
    let seconds = crate::seconds();
    let stage = Stage::new(&CAMERAS.map(|name| simulated(name, "{camera}.png", "")).concat());
    for name in CAMERAS {
        stage.write_mask(&format!("{name}.png"), (752, 480), 60);
    }
    let mask_file = stage.file("left.png").to_string_lossy().into_owned();
    let consumers = || CAMERAS.map(|camera| stage.watch(&[camera, "--mask", &mask_file]));
    let (steady, also_steady, stopping, mut dying) = (consumers(), consumers(), consumers(), consumers());
    let driver = stage.driver();
    for camera in CAMERAS {
        let mut subscriber = stage.subscriber(camera);
        wait_until("the camera streams", || subscriber.receive().unwrap().is_some());
    }

    let start = Instant::now();
    for second in 1..=seconds {
        // Time passes here because it is what is tested.
        std::thread::sleep(Duration::from_secs(second).saturating_sub(start.elapsed()));
        match second % STOP_EVERY_S {
            STOPPED_S => stopping.iter().for_each(|consumer| consumer.signal(Signal::STOP)),
            rest if rest == 2 * STOPPED_S => {
                stopping.iter().for_each(|consumer| consumer.signal(Signal::CONT))
            }
            _ => {}
        }
        if second % KILL_EVERY_S == 0 {
            let born = consumers();
            std::mem::replace(&mut dying, born).into_iter().for_each(Process::kill);
        }
    }
    stopping.iter().for_each(|consumer| consumer.signal(Signal::CONT));

    let produced = seconds * 60;
    let [steady, also_steady, stopping] = [steady, also_steady, stopping].map(reports);
    let said = stderr(&driver.stop());
    for report in steady.iter().chain(&also_steady) {
        println!("{report}");
        let kept_up = report["lost"] == 0 && report["epochs"] == 1 && report["masked_nonzero"] == 0;
        assert!(kept_up && report["frames"].as_u64().unwrap() >= produced * 98 / 100, "{report}\n{said}");
    }
    for report in &stopping {
        let [frames, lost] = ["frames", "lost"].map(|key| report[key].as_u64().unwrap());
        assert!(lost >= LOST_PER_STOP * (seconds / STOP_EVERY_S), "{report}");
        assert!(frames + lost >= produced * 98 / 100, "a loss was not counted: {report}");
    }
    let none_lost = said.matches(" 0 lost (0 of them incomplete), no free slot 0 times").count();
    assert_eq!(none_lost, CAMERAS.len(), "{said}");
}

fn reports(consumers: [Process; 3]) -> [Value; 3] {
    consumers.map(|consumer| {
        consumer.signal(Signal::INT);
        consumer.json()
    })
}
