//! How long a frame takes from the send until a consumer has it, in each language: one driver, one consumer at a time, in turns.
//!
//! `cargo bench -p uvcam-tests --bench languages`; with `-- --rounds 9 --frames 600` it takes longer.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use clap::Parser;
use uvcam_shm_ipc::{Settings, Subscriber, monotonic_ns};
use uvcam_tests::{Stage, c, next_frame, simulated};

/// Frames that every consumer lets pass first.
const WARM_UP: usize = 30;

#[derive(Parser)]
struct Arguments {
    /// Consumers of each language, one after the other.
    #[arg(long, default_value_t = 7)]
    rounds: usize,
    /// Frames of each consumer.
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Given by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
    /// Be the consumer in Rust: camera, prefix, root_path, frames.
    #[arg(long, hide = true, num_args = 4)]
    consume: Option<Vec<String>>,
}

fn main() {
    let arguments = Arguments::parse();
    if let Some(words) = &arguments.consume {
        return consume(words);
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/languages");
    let c = c::compiled(&here.join("latency.c"), "latency-c", &["-std=c11", "-O2"]);
    let cpp = c::compiled(&here.join("latency.cpp"), "latency-cpp", &["-std=c++17", "-O2"]);
    let stage = Stage::new(&simulated("left", "left.png", ""));
    stage.write_mask("left.png", (752, 480), 40);
    let driver = stage.driver();
    next_frame(&mut stage.subscriber("left"));

    let own = std::env::current_exe().unwrap();
    let mut found: BTreeMap<&str, Vec<(f64, f64, f64)>> = BTreeMap::new();
    for round in 0..arguments.rounds {
        let mut consumers = [
            ("Rust", {
                let Settings { prefix, root_path, .. } = stage.settings();
                let mut command = Command::new(&own);
                command.arg("--consume").arg("left").arg(prefix).arg(root_path);
                command
            }),
            ("C", c::consumer(&c, stage.settings(), "left")),
            ("C++", c::consumer(&cpp, stage.settings(), "left")),
        ];
        // Each time, another one begins.
        consumers.rotate_left(round % 3);
        for (language, mut command) in consumers {
            let output = c::succeeds(command.arg((WARM_UP + arguments.frames).to_string()));
            let said = String::from_utf8(output.stdout).unwrap();
            let mut latencies: Vec<u64> =
                said.lines().skip(WARM_UP).map(|line| line.parse().unwrap()).collect();
            latencies.sort_unstable();
            let at = |quantile: f64| latencies[(latencies.len() as f64 * quantile) as usize] as f64 / 1000.0;
            found.entry(language).or_default().push((at(0.1), at(0.5), at(0.99)));
        }
    }
    drop(driver);
    println!(
        "752x480 at 60 fps, {} rounds of {} frames, default wait, medians over rounds",
        arguments.rounds, arguments.frames
    );
    println!("send to receive, us      p10      p50      p99");
    for (language, values) in &found {
        let median = |select: fn(&(f64, f64, f64)) -> f64| {
            let mut values: Vec<f64> = values.iter().map(select).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let [p10, p50, p99] = [median(|it| it.0), median(|it| it.1), median(|it| it.2)];
        println!("{language:19} {p10:8.1} {p50:8.1} {p99:8.1}");
    }
}

/// A line for each frame: nanoseconds from the send until it was there.
fn consume(words: &[String]) {
    let [camera, prefix, root_path, frames] = words else { panic!("four words") };
    let mut left: usize = frames.parse().unwrap();
    let settings = Settings::new(prefix, root_path);
    let mut subscriber = Subscriber::open(&settings, camera).unwrap();
    let mut latencies = Vec::with_capacity(left);
    while left > 0 {
        subscriber.wait(Duration::from_secs(1)).unwrap();
        while let Some(frame) = subscriber.receive().unwrap().filter(|_| left > 0) {
            let header = frame.header();
            latencies.push(monotonic_ns() - header.send_monotonic_ns);
            left -= 1;
        }
    }
    latencies.iter().for_each(|latency| println!("{latency}"));
}
