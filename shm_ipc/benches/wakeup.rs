//! What it costs to wait for a frame: each [`Wakeup`] beside polling, the same frames, interleaved rounds of one run.
//!
//! `cargo bench -p uvcam-shm-ipc --bench wakeup`. A driver process sends frames of 752x480 at 60 fps; one consumer process waits for
//! them. Latency is from just before the send to the frame in the consumer's hands; processor time is that of the consumer.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a bench may panic")]

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};
use uvcam_shm_ipc::{FrameHeader, PixelFormat, Publisher, Settings, Subscriber, Wakeup, monotonic_ns};

const CAMERA: &str = "bench";
const PERIOD_NS: u64 = 16_666_667;
const FRAMES: usize = 300;
const ROUNDS: usize = 3;
const ROLE: &str = "UVCAM_BENCH_ROLE";
const FOLDER: &str = "UVCAM_BENCH_FOLDER";
const WAYS: [(&str, Option<Wakeup>); 4] = [
    ("polling", None),
    ("futex", Some(Wakeup::Futex)),
    ("predictive", Some(Wakeup::Predictive)),
    ("event", Some(Wakeup::Event)),
];

fn main() {
    let Ok(role) = std::env::var(ROLE) else { return compare() };
    let folder = std::env::var(FOLDER).unwrap();
    let unique: String = folder.chars().filter(char::is_ascii_alphanumeric).collect();
    let settings = Settings::new(format!("{unique}_"), folder);
    match WAYS.iter().find(|(name, _)| *name == role) {
        Some((_, wakeup)) => consume(&settings, *wakeup),
        None => drive(&settings),
    }
}

/// Sends frames until its input ends.
fn drive(settings: &Settings) {
    let mut publisher = Publisher::create(settings, CAMERA, 752 * 480, 6).unwrap();
    println!("ready");
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    std::thread::spawn(move || {
        std::io::stdin().lines().for_each(drop);
        // Relaxed: the flag carries no data.
        told.store(true, Ordering::Relaxed);
    });
    let mut header = FrameHeader::new(752, 480, 752, PixelFormat::Mono8);
    header.frame_period_ns = PERIOD_NS;
    let start_ns = monotonic_ns();
    for sequence in 0.. {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let due_ns = start_ns + sequence * PERIOD_NS;
        let due =
            Timespec { tv_sec: (due_ns / 1_000_000_000) as i64, tv_nsec: (due_ns % 1_000_000_000) as i64 };
        while clock_nanosleep_absolute(ClockId::Monotonic, &due).is_err() {}
        let slot = publisher.loan().unwrap();
        header.sequence = sequence;
        // The time that the frame before took to be sent travels in a field that nobody uses here.
        let begin_ns = monotonic_ns();
        publisher.publish(slot, &header).unwrap();
        header.device_timestamp_ns = monotonic_ns() - begin_ns;
    }
}

/// Prints the processor time per frame, then latency and sending time of each frame, ns.
fn consume(settings: &Settings, wakeup: Option<Wakeup>) {
    let mut subscriber = Subscriber::open(settings, CAMERA).unwrap();
    subscriber.set_wakeup(wakeup.unwrap_or_default());
    let mut next = || {
        loop {
            if let Some(frame) = subscriber.receive().unwrap() {
                let latency_ns = monotonic_ns() - frame.header().send_monotonic_ns;
                return (latency_ns, frame.header().device_timestamp_ns);
            }
            match wakeup {
                Some(_) => drop(subscriber.wait(Duration::from_secs(1)).unwrap()),
                None => std::hint::spin_loop(),
            }
        }
    };
    (0..60).for_each(|_| _ = next());
    let before = cpu_ns();
    let taken: Vec<_> = (0..FRAMES).map(|_| next()).collect();
    println!("{}", (cpu_ns() - before) / FRAMES as u64);
    taken.iter().for_each(|(latency_ns, sending_ns)| println!("{latency_ns} {sending_ns}"));
}

fn cpu_ns() -> u64 {
    let used = clock_gettime(ClockId::ProcessCPUTime);
    used.tv_sec as u64 * 1_000_000_000 + used.tv_nsec as u64
}

#[derive(Default)]
struct Figures {
    latencies: Vec<u64>,
    sendings: Vec<u64>,
    cpu_ns: Vec<u64>,
}

fn compare() {
    let folder = tempfile::tempdir().unwrap();
    let start = |role: &str| {
        Command::new(std::env::current_exe().unwrap())
            .env(ROLE, role)
            .env(FOLDER, folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let mut results: Vec<Figures> = WAYS.iter().map(|_| Figures::default()).collect();
    let mut driver = start("driver");
    BufReader::new(driver.stdout.take().unwrap()).lines().next().unwrap().unwrap();
    for _ in 0..ROUNDS {
        for ((name, _), result) in WAYS.iter().zip(&mut results) {
            read(start(name), result);
        }
    }
    drop(driver.stdin.take());
    driver.wait().unwrap();
    let mut out = std::io::stdout();
    writeln!(out, "wait         p50 us  p99 us  send p50 us  consumer's core at 60 fps").unwrap();
    for ((name, _), result) in WAYS.iter().zip(&mut results) {
        let [p50, p99] = [0.5, 0.99].map(|part| percentile(&mut result.latencies, part) / 1000.0);
        let send = percentile(&mut result.sendings, 0.5) / 1000.0;
        let core = percentile(&mut result.cpu_ns, 0.5) / PERIOD_NS as f64 * 100.0;
        writeln!(out, "{name:12} {p50:6.1}  {p99:6.1}  {send:11.1}  {core:5.2} %").unwrap();
    }
}

fn read(mut consumer: Child, result: &mut Figures) {
    let mut lines = BufReader::new(consumer.stdout.take().unwrap()).lines().map(Result::unwrap);
    result.cpu_ns.push(lines.next().unwrap().parse().unwrap());
    for line in lines {
        let (latency, sending) = line.split_once(' ').unwrap();
        result.latencies.push(latency.parse().unwrap());
        result.sendings.push(sending.parse().unwrap());
    }
    assert!(consumer.wait().unwrap().success());
}

fn percentile(values: &mut [u64], part: f64) -> f64 {
    values.sort_unstable();
    values[((values.len() - 1) as f64 * part).round() as usize] as f64
}
