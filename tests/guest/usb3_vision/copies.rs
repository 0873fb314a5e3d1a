//! Where the kernel puts pixels: seen by the kernel itself, at the one place where a transfer is asked for.

use std::fs;
use std::ops::Range;
use std::path::Path;

use uvcam_emulated::usb::Plugged;
use uvcam_emulated::usb3_vision::{Camera, Identity};
use uvcam_tests::{Process, Stage, children, next_frame};

use super::{BYTES, SIZE, camera};

const TRACING: &str = "/sys/kernel/tracing";
/// A probe at the submission of a transfer by a program (Linux 6.1, drivers/usb/core/devio.c): its second argument is a
/// `struct usbdevfs_urb`.
const PROBE: &str =
    "p:uvcam/submit usbcore:proc_do_submiturb endpoint=+1(%si):u8 buffer=+16(%si):x64 length=+24(%si):s32";
const STREAM_ENDPOINT: &str = "130";
const FRAMES: usize = 60;

fn write(file: &str, text: &str) {
    fs::write(Path::new(TRACING).join(file), text).unwrap_or_else(|error| panic!("{file}: {error}"));
}

/// Places and lengths of all transfers of the streaming endpoint in the trace.
fn transfers() -> Vec<Range<u64>> {
    let trace = fs::read_to_string(Path::new(TRACING).join("trace")).unwrap();
    let field = |line: &str, name: &str| {
        let value = line.split_whitespace().find_map(|word| word.strip_prefix(name)?.strip_prefix('='));
        value.map(str::to_owned)
    };
    trace
        .lines()
        .filter(|line| field(line, "endpoint").is_some_and(|endpoint| endpoint == STREAM_ENDPOINT))
        .map(|line| {
            let buffer = field(line, "buffer").unwrap();
            let start = u64::from_str_radix(buffer.trim_start_matches("0x"), 16).unwrap();
            start..start + field(line, "length").unwrap().parse::<u64>().unwrap()
        })
        .collect()
}

/// Where the process of a driver's only camera has shared memory.
fn shared_memory(process: &Process) -> Vec<Range<u64>> {
    let maps = fs::read_to_string(format!("/proc/{}/maps", children(process.id())[0])).unwrap();
    maps.lines()
        .filter(|line| line.contains("/dev/shm/"))
        .map(|line| {
            let (start, end) = line.split_whitespace().next().unwrap().split_once('-').unwrap();
            let address = |text| u64::from_str_radix(text, 16).unwrap();
            address(start)..address(end)
        })
        .collect()
}

#[test]
fn the_kernel_writes_pixels_into_the_memory_that_consumers_read() {
    let _device = Plugged::new(Camera::new(Identity::with_serial("U3V1")));
    let stage = Stage::new(&camera("left", "U3V1"));
    stage.write_mask("mask.png", SIZE, 100);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    next_frame(&mut subscriber);

    write("kprobe_events", PROBE);
    write("events/uvcam/submit/enable", "1");
    // One was under way.
    (0..=FRAMES).for_each(|_| drop(next_frame(&mut subscriber)));
    write("events/uvcam/submit/enable", "0");

    let shared = shared_memory(&driver);
    let straight: u64 = transfers()
        .into_iter()
        .filter(|transfer| shared.iter().any(|area| area.start <= transfer.start && transfer.end <= area.end))
        .map(|transfer| transfer.end - transfer.start)
        .sum();
    let whole = (FRAMES * BYTES) as u64..((FRAMES + 2) * BYTES) as u64;
    assert!(whole.contains(&straight), "{straight} bytes of {FRAMES} frames of {BYTES}");
    println!("\n| none: from the kernel into shared memory | {FRAMES} frames, every byte | 0 | - |");
    assert_eq!(subscriber.lost(), 0);
}
