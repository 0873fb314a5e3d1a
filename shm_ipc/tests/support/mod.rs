//! A place of its own in shared memory for each test, and frames to send through it.
#![allow(dead_code, reason = "every test file uses a part")]

pub mod child;
pub mod namespace;

use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use tempfile::TempDir;
use uvcam_shm_ipc::{
    Frame, FrameHeader, IpcError, PixelFormat, Publisher, Settings, Subscriber, cleanup_dead_nodes,
};

pub const CAMERA: &str = "left";
pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 8;
pub const FRAME_BYTES: usize = (WIDTH * HEIGHT) as usize;
pub const LOANS: usize = 3;
/// Bounds every wait for a condition: reached only where the condition never comes.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Settings that no other test shares, and their files for the time of the test.
pub struct Place {
    pub settings: Settings,
    pub folder: TempDir,
}

impl Place {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let folder = tempfile::tempdir().unwrap();
        let prefix = format!("test{}_{}_", process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let settings = with(Settings::new(prefix, folder.path().join("ipc")), |it| {
            (it.max_subscribers, it.buffer, it.borrowed) = (2, 4, 2);
        });
        Place { settings, folder }
    }

    pub fn publisher(&self) -> Publisher {
        Publisher::create(&self.settings, CAMERA, FRAME_BYTES, LOANS).unwrap()
    }

    pub fn subscriber(&self) -> Subscriber {
        Subscriber::open(&self.settings, CAMERA).unwrap()
    }

    pub fn subscriber_of(&self, camera: &str) -> Result<Subscriber, IpcError> {
        Subscriber::open(&self.settings, camera)
    }

    /// Files that this place has in shared memory, with their sizes.
    pub fn shared_memory(&self) -> Vec<(String, u64)> {
        let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let named = entries
            .filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.metadata().ok()?.len())));
        named.filter(|(name, _)| name.starts_with(&self.settings.prefix)).collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        cleanup_dead_nodes(&self.settings);
        for (name, _) in self.shared_memory() {
            let _ = std::fs::remove_file(format!("/dev/shm/{name}"));
        }
    }
}

/// A value with something changed.
pub fn with<T>(mut value: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut value);
    value
}

pub fn header(epoch: u64, sequence: u64) -> FrameHeader {
    let mut header = FrameHeader::new(WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8);
    header.epoch = epoch;
    header.sequence = sequence;
    header.device_frame_id = sequence;
    header
}

/// Bytes that tell frames and places in them apart.
pub fn pixel(sequence: u64, index: usize) -> u8 {
    (sequence as usize).wrapping_mul(31).wrapping_add(index * 7 + index / 256) as u8
}

pub fn publish(publisher: &mut Publisher, epoch: u64, sequence: u64) -> usize {
    publish_after_loss(publisher, epoch, sequence, 0)
}

pub fn publish_after_loss(publisher: &mut Publisher, epoch: u64, sequence: u64, lost_before: u64) -> usize {
    publisher.count_lost(lost_before);
    let mut slot = publisher.loan().unwrap();
    slot.pixels_mut().iter_mut().enumerate().for_each(|(index, byte)| *byte = pixel(sequence, index));
    publisher.publish(slot, &header(epoch, sequence)).unwrap()
}

pub fn assert_pixels(frame: &Frame) {
    let sequence = frame.header().sequence;
    assert_eq!(frame.pixels().len(), FRAME_BYTES);
    let wrong = frame.pixels().iter().enumerate().position(|(index, byte)| *byte != pixel(sequence, index));
    assert_eq!(wrong, None, "first wrong byte of frame {sequence}");
}

/// The file, and the place in it, that lies behind an address.
pub fn behind(address: usize) -> (String, usize) {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let line = maps.lines().find_map(|line| {
        let mut fields = line.split_whitespace();
        let (begin, end) = fields.next()?.split_once('-')?;
        let begin = usize::from_str_radix(begin, 16).ok()?;
        (begin..usize::from_str_radix(end, 16).ok()?).contains(&address).then_some((begin, fields))
    });
    let (begin, mut fields) = line.unwrap();
    let offset = usize::from_str_radix(fields.nth(1).unwrap(), 16).unwrap();
    (fields.collect::<Vec<_>>().join(" "), offset + address - begin)
}

/// Waits until the subscriber has found the publisher.
pub fn meet(publisher: &Publisher, subscriber: &mut Subscriber) {
    wait_until("the consumer", || {
        subscriber.wait(Duration::from_millis(1)).unwrap();
        publisher.subscribers() == 1
    });
}

/// Waits for a frame.
pub fn receive(subscriber: &mut Subscriber) -> Frame {
    assert!(subscriber.wait(PATIENCE).unwrap(), "no frame came");
    subscriber.receive().unwrap().unwrap()
}

/// Every unread frame.
pub fn drain(subscriber: &mut Subscriber) -> Vec<(u64, u64)> {
    std::iter::from_fn(|| subscriber.receive().unwrap())
        .map(|frame| (frame.header().sequence, frame.lost_before()))
        .collect()
}

/// Waits for a condition that another process or thread brings about.
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !condition() {
        assert!(begin.elapsed() < PATIENCE, "never came: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
