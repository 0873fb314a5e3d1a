//! What a frame costs between its slot and its consumers, apart from its pixels.

#![allow(clippy::unwrap_used, reason = "a bench may panic")]

use divan::Bencher;
use uvcam_shm_ipc::{FrameHeader, PixelFormat, Publisher, Settings, Subscriber};

const CAMERA: &str = "bench";
const LOANS: usize = 6;
const WIDTH: u32 = 752;
const HEIGHT: u32 = 480;

fn main() {
    divan::main();
}

fn header() -> FrameHeader {
    FrameHeader::new(WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8)
}

/// Runs `body` with a publisher in shared memory that nothing else uses, and as many consumers.
fn with_publisher(consumers: usize, body: impl FnOnce(&mut Publisher, &mut [Subscriber])) {
    let folder = tempfile::tempdir().unwrap();
    let unique: String =
        folder.path().to_string_lossy().chars().filter(char::is_ascii_alphanumeric).collect();
    let settings = Settings::new(format!("{unique}_"), folder.path());
    let mut publisher = Publisher::create(&settings, CAMERA, (WIDTH * HEIGHT) as usize, LOANS).unwrap();
    let mut subscribers: Vec<_> =
        (0..consumers).map(|_| Subscriber::open(&settings, CAMERA).unwrap()).collect();
    // The first frame connects them.
    publisher.publish(publisher.loan().unwrap(), &header()).unwrap();
    subscribers.iter_mut().for_each(|subscriber| assert!(subscriber.receive().unwrap().is_some()));
    body(&mut publisher, &mut subscribers);
}

/// Checks a header and copies it into shared memory.
#[divan::bench]
fn header_write(bencher: Bencher) {
    let mut place = header();
    bencher.bench_local(|| {
        let header = divan::black_box(header());
        header.validate((WIDTH * HEIGHT) as usize).unwrap();
        *divan::black_box(&mut place) = header;
    });
}

/// Takes a slot and gives it back.
#[divan::bench]
fn loan(bencher: Bencher) {
    with_publisher(0, |publisher, _| bencher.bench_local(|| publisher.loan().unwrap()));
}

/// Takes a slot and sends it, to consumers that do not move: the oldest frame gives way.
#[divan::bench(args = [0, 1, 4])]
fn loan_and_send(bencher: Bencher, consumers: usize) {
    with_publisher(consumers, |publisher, _| {
        bencher.bench_local(|| publisher.publish(publisher.loan().unwrap(), &header()).unwrap());
    });
}

/// The whole way of a frame from one thread to itself: loan, send, receive, give back.
#[divan::bench]
fn loan_send_and_receive(bencher: Bencher) {
    with_publisher(1, |publisher, subscribers| {
        bencher.bench_local(|| {
            publisher.publish(publisher.loan().unwrap(), &header()).unwrap();
            subscribers[0].receive().unwrap().unwrap()
        });
    });
}
