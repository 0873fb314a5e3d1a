//! The laws of this path, in the words of its head, each with what shows that it holds. The last one is [`loss`](super::loss)'s.

use std::sync::atomic::AtomicU64;

use tracing::span::{Attributes, Id, Record};
use tracing::{Event as LogEvent, Metadata};
use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::Frame;

use super::*;
use crate::config::MaskMode;
use crate::mask::FlyingMask;

/// A path and its consumers.
struct Scene {
    place: Place,
    publisher: Publisher,
    camera: Instant,
    mask: MaskInForce,
    counters: Counters,
}

impl Scene {
    fn new(mask: Mask) -> Self {
        let place = Place::new();
        let publisher = Publisher::create(&place.settings, "left", (WIDTH * HEIGHT) as usize, SLOTS).unwrap();
        let camera = Instant::new();
        Scene {
            place,
            publisher,
            camera,
            mask: Some(Arc::new(FlyingMask::new(mask, MaskMode::Blank))),
            counters: Counters::default(),
        }
    }

    fn subscriber(&self) -> Subscriber {
        Subscriber::open(&self.place.settings, "left").unwrap()
    }

    /// Walks the path with what `walk` does there.
    fn walk<T>(&mut self, walk: impl FnOnce(&mut FramePath<'_>) -> T) -> T {
        let (_, commands) = channel();
        walk(&mut FramePath {
            camera: &mut self.camera,
            applied: &applied(WIDTH, HEIGHT),
            publisher: &mut self.publisher,
            mask: &mut self.mask,
            commands: &commands,
            counters: &self.counters,
            header: FrameHeader::new(WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8),
            first_frame_patience: PATIENCE,
            slots: SLOTS,
            position: Position::default(),
        })
    }
}

fn checkered() -> Mask {
    Mask::from_fn(WIDTH, HEIGHT, |x, y| (x / 8 + y / 8) % 7 == 0)
}

/// The next frame, complete.
fn complete(path: &mut FramePath<'_>) -> Capture {
    path.fill_queue().unwrap();
    let Event::Complete(capture) = path.camera.next(PATIENCE).unwrap() else { panic!("no frame") };
    path.position.queued -= 1;
    capture
}

#[test]
fn from_complete_to_sent_no_allocation() {
    let mut scene = Scene::new(checkered());
    // One consumer reads, one listens to the event and never reads: its oldest frames give way.
    let mut reader = scene.subscriber();
    let mut listener = scene.subscriber();
    listener.set_wakeup(Wakeup::Event);
    assert!(!listener.wait(Duration::from_millis(1)).unwrap());
    scene.walk(|path| {
        for frame in 0..=FRAMES {
            let capture = complete(path);
            let mut sent = Ok(());
            let allocated = allocation_counter::measure(|| sent = path.publish(capture));
            sent.unwrap();
            // The first frame connects the consumers that came since the last one.
            assert!(frame == 0 || allocated.count_total == 0, "frame {frame}: {allocated:?}");
            assert_eq!(reader.receive().unwrap().unwrap().header().sequence, frame);
        }
    });
    assert_eq!((reader.lost(), scene.counters.lost.into_inner()), (0, 0));
    assert_eq!(scene.counters.published.into_inner(), FRAMES + 1);
}

/// The file that is mapped at an address of this process, and the place in it (proc_pid_maps(5)).
fn place_in_file(address: usize) -> (String, usize) {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines()
        .find_map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [range, _, offset, _, _, file] = words[..] else { return None };
            let (start, end) = range.split_once('-')?;
            let [start, end, offset] =
                [start, end, offset].map(|number| usize::from_str_radix(number, 16).unwrap());
            (start..end).contains(&address).then(|| (file.to_owned(), offset + address - start))
        })
        .expect("a mapped file")
}

#[test]
fn from_complete_to_sent_no_copy_of_pixels() {
    let mut scene = Scene::new(checkered());
    let mut reader = scene.subscriber();
    scene.walk(|path| {
        for _ in 0..3 * SLOTS {
            let capture = complete(path);
            let written = place_in_file(capture.slot.address());
            assert!(written.0.starts_with("/dev/shm/"), "{written:?}");
            path.publish(capture).unwrap();
            let frame = reader.receive().unwrap().unwrap();
            assert_eq!(place_in_file(frame.pixels().as_ptr() as usize), written);
        }
    });
}

/// Counts what is logged.
struct Log(Arc<AtomicU64>);

impl tracing::Subscriber for Log {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn event(&self, _: &LogEvent<'_>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        self.0.fetch_add(1, Ordering::Relaxed);
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}

#[test]
fn from_complete_to_sent_no_log() {
    let mut scene = Scene::new(checkered());
    let _never_reads = scene.subscriber();
    let logged = Arc::new(AtomicU64::new(0));
    tracing::subscriber::with_default(Log(Arc::clone(&logged)), || {
        scene.walk(|path| {
            for _ in 0..300 {
                let capture = complete(path);
                let before = logged.load(Ordering::Relaxed);
                path.publish(capture).unwrap();
                assert_eq!(logged.load(Ordering::Relaxed), before);
            }
        });
        tracing::trace!("the measure is one that can fail");
        assert!(logged.load(Ordering::Relaxed) > 0);
    });
}

#[test]
fn from_complete_to_sent_no_wait_for_a_consumer() {
    let mut scene = Scene::new(checkered());
    let (_never_reads, mut holds) = (scene.subscriber(), scene.subscriber());
    let mut held: Vec<Frame> = Vec::new();
    // Nobody but this thread could end a wait.
    scene.walk(|path| {
        for _ in 0..300 {
            let capture = complete(path);
            path.publish(capture).unwrap();
            // Until it holds all that it may.
            held.extend(holds.receive().ok().flatten());
        }
    });
    assert!(!held.is_empty());
    assert_eq!((scene.counters.published.into_inner(), scene.counters.lost.into_inner()), (300, 0));
}

#[test]
fn a_frame_that_is_not_whole_is_never_sent() {
    let mut scene = Scene::new(checkered());
    scene.camera.is_incomplete = |number| number % 3 == 1;
    scene.camera.frames = 30;
    let mut reader = scene.subscriber();
    let end = scene.walk(|path| path.run(&AtomicBool::new(false), || ()).map(drop)).unwrap_err();
    assert!(end.to_string().contains("disconnected"), "{end}");
    let mut seen = Vec::new();
    while let Some(frame) = reader.receive().unwrap() {
        seen.push(frame.header().device_frame_id);
    }
    let buffered = scene.place.settings.buffer.min(20);
    let whole: Vec<u64> = (0..30).filter(|number| number % 3 != 1).collect();
    assert_eq!(seen, whole[whole.len() - buffered..]);
    assert_eq!((scene.counters.published.into_inner(), scene.counters.incomplete.into_inner()), (20, 10));
}

#[test]
fn a_frame_that_is_not_masked_as_configured_is_never_sent() {
    // As configured: every masked pixel is blank, and no other.
    let mask = checkered();
    let mut scene = Scene::new(checkered());
    let mut reader = scene.subscriber();
    scene.walk(|path| {
        for _ in 0..30 {
            let capture = complete(path);
            path.publish(capture).unwrap();
            let frame = reader.receive().unwrap().unwrap();
            let image = ImageView::new(frame.pixels(), WIDTH, HEIGHT, WIDTH as usize, 1).unwrap();
            assert_eq!(mask.masked_nonzero(&image).unwrap(), 0);
            let kept = frame.pixels().iter().filter(|pixel| **pixel == 255).count() as u64;
            assert_eq!(kept, u64::from(WIDTH * HEIGHT) - mask.masked_px());
        }
    });

    // A mask that does not fit the frame ends the epoch.
    let mut scene = Scene::new(Mask::from_fn(HEIGHT, WIDTH, |x, _| x < 8));
    let mut reader = scene.subscriber();
    let error = scene.walk(|path| path.run(&AtomicBool::new(false), || ()).map(drop)).unwrap_err();
    assert!(error.to_string().contains("480x752"), "{error}");
    assert!(reader.receive().unwrap().is_none());
    assert_eq!((scene.counters.published.into_inner(), scene.counters.lost.into_inner()), (0, 1));
}
