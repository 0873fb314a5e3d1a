//! "What the device is known to have produced and this stream did not publish is counted as soon as it is known, and the next header
//! tells": over ends of streams that were thought of, and random ones.

use std::collections::VecDeque;

use proptest::collection::vec;
use proptest::prelude::*;
use uvcam_shm_ipc::Frame;

use super::*;

const FRAME_BYTES: u32 = 64;

/// What becomes of the device's next frame.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fate {
    Whole,
    /// It comes with a part missing.
    Incomplete,
    /// It never comes; the device's count tells.
    Missing,
    /// It comes, and the consumer wakes up and reads one.
    WholeAndRead,
    /// It comes after a reset, with an id that was there before.
    Reset,
}
use Fate::*;

/// A device that produces frames by script, and is then gone.
struct Scripted<'a> {
    identity: Identity,
    queued: VecDeque<Slot>,
    fates: VecDeque<Fate>,
    produced: u64,
    counts: bool,
    consumer: &'a mut Consumer,
}

impl Scripted<'_> {
    fn gone(&self) -> CameraError {
        CameraError::Disconnected { serial: self.identity.serial.clone(), doing: "streaming" }
    }
}

impl Camera for Scripted<'_> {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn configure(&mut self, _: &CameraSettings) -> Result<Applied, CameraError> {
        unreachable!("the path gets what was applied")
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.queued.push_back(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn next(&mut self, _: Duration) -> Result<Event, CameraError> {
        loop {
            let fate = self.fates.pop_front().ok_or_else(|| self.gone())?;
            let frame_id = if fate == Reset { 0 } else { self.produced };
            let counts = self.counts || matches!(fate, Whole | WholeAndRead | Reset);
            self.produced += u64::from(counts);
            if fate == Missing {
                continue;
            }
            let slot = self.queued.pop_front().expect("the path keeps the queue filled");
            if fate == WholeAndRead {
                self.consumer.read();
            }
            return Ok(match fate {
                Incomplete => Event::Incomplete(slot),
                _ => Event::Complete(Capture {
                    slot,
                    frame_id,
                    device_timestamp_ns: None,
                    arrival_monotonic_ns: monotonic_ns(),
                }),
            });
        }
    }

    fn stop(&mut self) {
        self.queued.clear();
    }
}

/// A consumer, and the `produced` of the first and the last frame that it read.
struct Consumer {
    subscriber: Subscriber,
    span: Option<(u64, u64)>,
}

impl Consumer {
    fn read(&mut self) -> Option<Frame> {
        let frame = self.subscriber.receive().unwrap()?;
        let produced = frame.header().produced;
        self.span = Some((self.span.map_or(produced, |(first, _)| first), produced));
        Some(frame)
    }
}

/// Flies a camera through these streams, one after the other, whose device counts its frames or does not. Returns what is known of it,
/// and the consumer, which has read all that was left for it.
fn fly(streams: &[Vec<Fate>], counts: bool) -> (Counters, Consumer) {
    let place = Place::new();
    let mut publisher = Publisher::create(&place.settings, "left", FRAME_BYTES as usize, SLOTS).unwrap();
    let subscriber = Subscriber::open(&place.settings, "left").unwrap();
    let mut consumer = Consumer { subscriber, span: None };
    let (_, commands) = channel();
    let counters = Counters::default();
    let stop = AtomicBool::new(false);
    for fates in streams {
        let mut camera = Scripted {
            identity: identity(),
            queued: VecDeque::new(),
            fates: fates.iter().copied().collect(),
            produced: 0,
            counts,
            consumer: &mut consumer,
        };
        let mut header = FrameHeader::new(FRAME_BYTES, 1, FRAME_BYTES, PixelFormat::Mono8);
        header.epoch = publisher.begin_epoch();
        let mut path = FramePath {
            camera: &mut camera,
            applied: &applied(FRAME_BYTES, 1),
            publisher: &mut publisher,
            mask: &mut None,
            commands: &commands,
            counters: &counters,
            header,
            first_frame_patience: PATIENCE,
            slots: SLOTS,
            position: Position::default(),
        };
        path.run(&stop, || ()).unwrap_err();
        let [lost, incomplete] =
            [&counters.lost, &counters.incomplete].map(|count| count.load(Ordering::Relaxed));
        assert!(lost >= incomplete, "{lost} lost, {incomplete} of them incomplete");
    }
    while consumer.read().is_some() {}
    (counters, consumer)
}

/// What the driver can know of a stream whose device counts: all up to the last whole frame, and what came after it.
fn known(fates: &[Fate]) -> u64 {
    let is_whole = |fate: &Fate| matches!(fate, Whole | WholeAndRead);
    let up_to_whole = fates.iter().rposition(is_whole).map_or(0, |last| last + 1);
    let after = fates[up_to_whole..].iter().filter(|fate| **fate == Incomplete).count();
    (up_to_whole + after) as u64
}

fn totals(counters: &Counters) -> (u64, u64, u64) {
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    (count(&counters.published), count(&counters.lost), count(&counters.incomplete))
}

#[test]
fn incomplete_frames_that_end_an_epoch_are_told_by_the_next() {
    let streams = [vec![WholeAndRead, Whole, Incomplete, Incomplete], vec![Whole]];
    let (counters, consumer) = fly(&streams, true);
    assert_eq!(totals(&counters), (3, 2, 2));
    assert_eq!((consumer.subscriber.frames(), consumer.subscriber.lost()), (3, 2));
}

#[test]
fn an_epoch_without_a_whole_frame_is_told() {
    let streams = [vec![Whole], vec![Incomplete; 3], vec![Missing, Incomplete, Whole]];
    let (counters, consumer) = fly(&streams, true);
    assert_eq!(totals(&counters), (2, 5, 4));
    assert_eq!(consumer.subscriber.lost(), 5);
}

#[test]
fn a_frame_is_counted_once_be_it_incomplete_and_among_the_missing() {
    let (counters, _) = fly(&[vec![Whole, Incomplete, Missing, Incomplete, Whole]], true);
    assert_eq!(totals(&counters), (2, 3, 2));
}

#[test]
fn incomplete_frames_of_a_device_that_does_not_count_are_lost() {
    let (counters, consumer) = fly(&[vec![Whole, Incomplete, Incomplete, Whole]], false);
    assert_eq!(totals(&counters), (2, 2, 2));
    assert_eq!(consumer.subscriber.lost(), 2);
}

#[test]
fn the_frame_by_which_a_reset_is_noticed_is_lost() {
    let (counters, consumer) = fly(&[vec![Whole, Whole, Reset], vec![Whole]], true);
    assert_eq!(totals(&counters), (3, 1, 0));
    assert_eq!((consumer.subscriber.lost(), consumer.subscriber.epochs()), (1, 2));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn received_and_told_is_what_is_known_to_have_been_produced(
        mut streams in vec(vec(proptest::sample::select(vec![Whole, Incomplete, Missing, WholeAndRead]), 0..20), 0..6),
    ) {
        // A last frame tells of all before it.
        streams.push(vec![Whole]);
        let (counters, consumer) = fly(&streams, true);
        let produced: u64 = streams.iter().map(|fates| known(fates)).sum();
        let (published, lost, _) = totals(&counters);
        prop_assert_eq!(published + lost, produced);
        let (first, last) = consumer.span.unwrap();
        prop_assert_eq!(last, produced);
        prop_assert_eq!(consumer.subscriber.frames() + consumer.subscriber.lost(), last - first + 1);
    }
}
