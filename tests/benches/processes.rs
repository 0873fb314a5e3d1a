//! What a process for each camera costs: three simulated cameras of 752x480 at 60 fps in three processes and a main one, and in one. Rounds
//! are interleaved, each beginning with the other way.
//!
//! `cargo bench -p uvcam-tests --bench processes`. Latency is from the whole frame in memory to the frame in the hands of a consumer that
//! sleeps in between, a thread for each camera; processor time and memory are those of all processes of the driver, the drawing of the
//! scenes included; the start is from the start of the program to the first frame of the last camera.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs;
use std::time::{Duration, Instant};

use uvcam_shm_ipc::{Subscriber, monotonic_ns};
use uvcam_tests::{Stage, children, next_frame, simulated};

const CAMERAS: [&str; 3] = ["left", "right", "back"];
const FRAMES: usize = 600;
const ROUNDS: usize = 5;
const PATIENCE: Duration = Duration::from_secs(1);

/// What one way costs, a number for each round but for latencies and losses.
#[derive(Default)]
struct Row {
    latencies_ns: Vec<u64>,
    lost: u64,
    processor_ns_per_frame: Vec<u64>,
    proportional_kib: Vec<u64>,
    private_kib: Vec<u64>,
    start_ms: Vec<u64>,
}

fn main() {
    let cameras = CAMERAS.map(|name| simulated(name, "{camera}.png", "")).concat();
    let [mut apart, mut together] = [Row::default(), Row::default()];
    for round in 0..ROUNDS {
        for way in 0..2 {
            match (round + way) % 2 {
                0 => measure(&Stage::new(&cameras), &mut apart),
                _ => measure(&Stage::in_one_process(&cameras), &mut together),
            }
        }
    }
    println!("three cameras          p50 us  p99 us  lost  us/frame  MB together  MB private  start ms");
    for (name, mut row) in [("a process each", apart), ("one process", together)] {
        row.latencies_ns.sort_unstable();
        let quantile = |part: f64| row.latencies_ns[((row.latencies_ns.len() - 1) as f64 * part) as usize];
        println!(
            "{name:22} {:6.1}  {:6.1}  {:4}  {:8.1}  {:11.1}  {:10.1}  {:8}",
            quantile(0.5) as f64 / 1e3,
            quantile(0.99) as f64 / 1e3,
            row.lost,
            median(row.processor_ns_per_frame) as f64 / 1e3,
            median(row.proportional_kib) as f64 / 1024.0,
            median(row.private_kib) as f64 / 1024.0,
            median(row.start_ms)
        );
    }
}

fn median(mut numbers: Vec<u64>) -> u64 {
    numbers.sort_unstable();
    numbers[numbers.len() / 2]
}

fn measure(stage: &Stage, row: &mut Row) {
    CAMERAS.iter().for_each(|name| _ = stage.write_mask(&format!("{name}.png"), (752, 480), 60));
    let mut subscribers = CAMERAS.map(|name| stage.subscriber(name));
    let start = Instant::now();
    let driver = stage.driver();
    subscribers.iter_mut().for_each(|subscriber| _ = next_frame(subscriber));
    row.start_ms.push(start.elapsed().as_millis().try_into().unwrap());

    let processes: Vec<u32> = children(driver.id()).into_iter().chain([driver.id()]).collect();
    let before_ns: u64 = processes.iter().map(|id| processor_ns(*id)).sum();
    let read = std::thread::scope(|scope| {
        let readers = subscribers.each_mut().map(|subscriber| scope.spawn(|| latencies(subscriber)));
        readers.map(|reader| reader.join().unwrap())
    });
    let after_ns: u64 = processes.iter().map(|id| processor_ns(*id)).sum();
    row.latencies_ns.extend(read.iter().flatten());
    row.lost += subscribers.iter().map(Subscriber::lost).sum::<u64>();
    row.processor_ns_per_frame.push((after_ns - before_ns) / (CAMERAS.len() * FRAMES) as u64);
    row.proportional_kib.push(processes.iter().map(|id| memory_kib(*id, &["Pss:"])).sum());
    row.private_kib
        .push(processes.iter().map(|id| memory_kib(*id, &["Private_Clean:", "Private_Dirty:"])).sum());
    assert!(driver.stop().status.success());
}

/// Ages of frames when the consumer has them.
fn latencies(subscriber: &mut Subscriber) -> Vec<u64> {
    let mut ages_ns = Vec::with_capacity(FRAMES);
    while ages_ns.len() < FRAMES {
        match subscriber.receive().unwrap() {
            Some(frame) => ages_ns.push(monotonic_ns() - frame.header().arrival_monotonic_ns),
            None => assert!(subscriber.wait(PATIENCE).unwrap(), "no frame"),
        }
    }
    ages_ns
}

/// Processor time of the living threads of a process: the first number of each `schedstat` (proc(5)).
fn processor_ns(process: u32) -> u64 {
    let threads = fs::read_dir(format!("/proc/{process}/task")).unwrap().flatten();
    let times = threads.filter_map(|thread| fs::read_to_string(thread.path().join("schedstat")).ok());
    times.map(|times| times.split_whitespace().next().unwrap().parse::<u64>().unwrap()).sum()
}

/// Sum of these fields of `smaps_rollup` (proc_pid_smaps(5)). Pages that several processes have count in `Pss` for a part in each.
fn memory_kib(process: u32, keys: &[&str]) -> u64 {
    let text = fs::read_to_string(format!("/proc/{process}/smaps_rollup")).unwrap();
    let fields = text.lines().filter(|line| keys.iter().any(|key| line.starts_with(key)));
    fields.map(|line| line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()).sum()
}
