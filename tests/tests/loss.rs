//! Every frame that a camera produced is received or told as lost, whoever sleeps, dies or comes back meanwhile.
#![allow(clippy::unwrap_used)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use uvcam_shm_ipc::{FrameHeader, Subscriber, monotonic_ns};
use uvcam_tests::dice::Dice;
use uvcam_tests::{Stage, stderr, wait_until};

/// Frames that wait for a consumer: as many as the camera produces in a quarter of a second.
const BUFFER: u64 = 64;

/// What happens to a camera from the start of its driver to the driver's end.
struct Life {
    faults: String,
    /// Frames that come incomplete; of these, at the ends of epochs.
    incomplete: u64,
    incomplete_at_ends: u64,
    epochs: u64,
    is_killed: bool,
    /// Frames that a killed driver may have counted and told nobody of.
    untold: u64,
    is_last: bool,
    /// Frames of the last epoch before its end.
    last_frames: u64,
}

impl Life {
    fn random(dice: &mut Dice, is_killed: bool) -> Self {
        let (mut faults, mut frame) = (Vec::new(), 0);
        let (mut all_incomplete, mut incomplete_at_ends) = (0, 0);
        let reconnections = 1 + dice.roll(3);
        for _ in 0..reconnections {
            let (lost, incomplete, last) = (1 + dice.roll(4), 1 + dice.roll(4), 1 + dice.roll(5));
            frame += 5 + dice.roll(2 * BUFFER);
            faults.push(format!("{{ kind = \"lost\", at_frame = {frame}, count = {lost} }}"));
            frame += lost + 5;
            faults.push(format!("{{ kind = \"incomplete\", at_frame = {frame}, count = {incomplete} }}"));
            frame += incomplete + 5;
            faults.push(format!("{{ kind = \"incomplete\", at_frame = {frame}, count = {last} }}"));
            frame += last;
            faults.push(format!("{{ kind = \"unplug\", at_frame = {frame}, seconds = 0.1 }}"));
            all_incomplete += incomplete + last;
            incomplete_at_ends += last;
        }
        // Half of the killed ones do not come to the end of their faults.
        let is_cut_short = is_killed && dice.roll(2) == 0;
        let epochs = if is_cut_short { 1 + dice.roll(reconnections) } else { reconnections + 1 };
        let never_sent = u64::from(is_killed);
        let (incomplete_at_ends, untold) = match is_cut_short {
            true => (0, never_sent + all_incomplete),
            false => (incomplete_at_ends, never_sent),
        };
        Life {
            faults: faults.join(", "),
            incomplete: all_incomplete,
            incomplete_at_ends,
            epochs,
            is_killed,
            untold,
            is_last: false,
            last_frames: 1 + dice.roll(3 * BUFFER),
        }
    }

    /// Nothing happens in the last one, which tells of those before.
    fn last() -> Self {
        Life {
            faults: String::new(),
            incomplete: 0,
            incomplete_at_ends: 0,
            epochs: 1,
            is_killed: false,
            untold: 0,
            is_last: true,
            last_frames: 10,
        }
    }

    fn write(&self, stage: &Stage, ipc: &str) {
        let camera = format!(
            "[[camera]]\nname = \"left\"\nsource = {{ kind = \"simulated\", serial = \"left\", still = true, faults = [{}] }}\n\
             width = 64\nheight = 48\nfps = 250\nexposure_us = 1000\nmask = \"none\"\n",
            self.faults
        );
        std::fs::write(stage.file("uvcam.toml"), format!("{ipc}\n{camera}")).unwrap();
    }
}

/// A consumer, and the `produced` of the first and the last frame that it received.
struct Consumer {
    subscriber: Subscriber,
    span: Option<(u64, u64)>,
}

impl Consumer {
    fn new(stage: &Stage) -> Self {
        Consumer { subscriber: stage.subscriber("left"), span: None }
    }

    /// Reads what is unread, so many frames at the most.
    fn read(&mut self, frames: u64, mut look_at: impl FnMut(&FrameHeader)) {
        for _ in 0..frames {
            let Some(frame) = self.subscriber.receive().unwrap() else { return };
            let produced = frame.header().produced;
            self.span = Some((self.span.map_or(produced, |(first, _)| first), produced));
            look_at(frame.header());
        }
    }

    /// The `produced` of its last frame: with its first, that is what it must have received or been told of.
    fn account(&self, who: &str) -> u64 {
        let (first, last) = self.span.unwrap();
        let (received, told) = (self.subscriber.frames(), self.subscriber.lost());
        println!("{who}: {received} received, {told} told, of {first} to {last}");
        assert_eq!(received + told, last - first + 1, "{who}");
        last
    }
}

/// What a consumer that never sleeps saw of an epoch.
struct Epoch {
    id: u64,
    first_arrival_ns: u64,
    /// Frames that the device produced, by its own count, up to the last whole one.
    produced: u64,
    /// What the driver had counted before.
    before: u64,
}

/// Takes a frame into account. Within an epoch, the driver counts as the device does.
fn look_at(epochs: &mut Vec<Epoch>, header: &FrameHeader) {
    let produced = header.device_frame_id + 1;
    let before = header.produced.checked_sub(produced).unwrap();
    match epochs.last_mut() {
        Some(epoch) if epoch.id == header.epoch => {
            assert_eq!(epoch.before, before, "{header:?}");
            epoch.produced = produced;
        }
        last => {
            assert!(last.is_none_or(|epoch| epoch.id < header.epoch), "{header:?}");
            let first_arrival_ns = header.arrival_monotonic_ns;
            epochs.push(Epoch { id: header.epoch, first_arrival_ns, produced, before });
        }
    }
}

/// "N frames published, M lost (K of them incomplete)" in what a driver said at its end.
fn summary(said: &str) -> (u64, u64, u64) {
    let line = said.lines().find(|line| line.contains(" frames published, ")).unwrap();
    let before = |word: &str| {
        let number = line.split(word).next().unwrap().rsplit([' ', '(']).next().unwrap();
        number.parse().unwrap_or_else(|_| panic!("before {word:?} in {line}"))
    };
    (before(" frames published"), before(" lost"), before(" of them incomplete"))
}

/// How far the witness has come: epochs seen, and frames of the last one.
#[derive(Default)]
struct Progress {
    epochs: AtomicU64,
    frames: AtomicU64,
    is_over: AtomicBool,
}

impl Progress {
    fn now(&self) -> (u64, u64) {
        (self.epochs.load(Ordering::Relaxed), self.frames.load(Ordering::Relaxed))
    }
}

/// Reads every frame until told that it is over, and nothing is unread.
fn witness(mut consumer: Consumer, progress: &Progress) -> (Consumer, Vec<Epoch>) {
    let mut epochs = Vec::new();
    loop {
        let is_over = progress.is_over.load(Ordering::Relaxed);
        consumer.read(u64::MAX, |header| {
            look_at(&mut epochs, header);
            progress.frames.store(header.sequence + 1, Ordering::Relaxed);
            progress.epochs.store(epochs.len() as u64, Ordering::Relaxed);
        });
        if is_over {
            return (consumer, epochs);
        }
        consumer.subscriber.wait(Duration::from_millis(20)).unwrap();
    }
}

/// Lets a driver live, while sleepers wake up now and then. Returns what it said at its end, where it was not killed.
fn live(
    life: &Life,
    stage: &Stage,
    progress: &Progress,
    sleepers: &mut [Consumer],
    dice: &mut Dice,
) -> Option<String> {
    let end = (progress.now().0 + life.epochs, life.last_frames);
    let driver = stage.driver();
    wait_until("the end of a life", || {
        sleepers
            .iter_mut()
            .filter(|sleeper| sleeper.span.is_none())
            .for_each(|sleeper| sleeper.read(1, |_| ()));
        // Each once in a second or so.
        if let Some(sleeper) = sleepers.get_mut(dice.roll(600) as usize) {
            sleeper.read(dice.roll(2 * BUFFER), |_| ());
        }
        progress.now() >= end
    });
    if life.is_last {
        // Who sleeps over all of a driver's life hears of it from the next one, and here is none.
        sleepers.iter_mut().for_each(|sleeper| sleeper.read(1, |_| ()));
    }
    if life.is_killed {
        driver.kill();
        return None;
    }
    Some(stderr(&driver.stop()))
}

#[test]
fn received_and_told_is_what_was_produced_over_sleeps_kills_reconnections_and_restarts() {
    let mut dice = Dice::new();
    let stage = Stage::new(&format!("buffer = {BUFFER}\n"));
    let ipc = std::fs::read_to_string(stage.file("uvcam.toml")).unwrap();
    let progress = Progress::default();
    let mut sleepers: Vec<_> = (0..3).map(|_| Consumer::new(&stage)).collect();
    let mut lives: Vec<_> = [true, false, true, true, false]
        .iter()
        .map(|is_killed| Life::random(&mut dice, *is_killed))
        .collect();
    lives.push(Life::last());
    // When drivers started, CLOCK_MONOTONIC in ns, and what they said.
    let mut said = Vec::new();

    let (witness, epochs) = std::thread::scope(|scope| {
        let witness = scope.spawn(|| witness(Consumer::new(&stage), &progress));
        for life in &lives {
            life.write(&stage, &ipc);
            let start_ns = monotonic_ns();
            // A witness that has failed sees no end of it.
            let end =
                catch_unwind(AssertUnwindSafe(|| live(life, &stage, &progress, &mut sleepers, &mut dice)));
            progress.is_over.fetch_or(end.is_err(), Ordering::Relaxed);
            said.push((start_ns, end.unwrap()));
        }
        progress.is_over.store(true, Ordering::Relaxed);
        witness.join().unwrap()
    });

    let last_produced = witness.account("the witness");
    for sleeper in &mut sleepers {
        sleeper.read(u64::MAX, |_| ());
        assert_eq!(sleeper.account("a sleeper"), last_produced);
    }
    // What the device's own ids and the script do not tell.
    let mut never_sent = last_produced;
    let ends_ns = said.iter().skip(1).map(|(start_ns, _)| *start_ns).chain([u64::MAX]);
    for ((life, (start_ns, said)), end_ns) in lives.iter().zip(&said).zip(ends_ns) {
        let of_life = |epoch: &&Epoch| (*start_ns..end_ns).contains(&epoch.first_arrival_ns);
        let produced: u64 = epochs.iter().filter(of_life).map(|epoch| epoch.produced).sum();
        let produced = produced + life.incomplete_at_ends;
        println!("{} epochs: {produced} produced", epochs.iter().filter(of_life).count());
        never_sent -= produced;
        if let Some(said) = said {
            let (published, lost, incomplete) = summary(said);
            assert_eq!((published + lost, incomplete), (produced, life.incomplete), "{said}");
            assert!(lost >= incomplete, "{said}");
        }
    }
    let untold: u64 = lives.iter().map(|life| life.untold).sum();
    println!("{never_sent} of at most {untold} that only a killed driver knew");
    assert!(never_sent <= untold, "{never_sent} frames that no device produced");
}
