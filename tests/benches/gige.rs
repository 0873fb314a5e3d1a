//! What each way of receiving GigE Vision costs: time from a frame's last packet on the wire to the frame in the hands of the program, and
//! frames lost, 752x480 at 60 fps over loopback from a camera in another process. Rows are measured one after the other, interleaved.
//!
//! `cargo bench -p uvcam-tests --bench gige`. The last packet is seen by a packet socket beside; its thread needs some microseconds to
//! wake, by which the figures are too small.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::num::NonZeroU32;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use aravis::prelude::*;
use aravis::{Buffer, BufferStatus, GvStreamOption};
use rustix::net::{AddressFamily, Protocol, RecvFlags, SocketFlags, SocketType, recv, socket_with};
use uvcam::camera::{Event, Settings};
use uvcam::realtime::Realtime;
use uvcam_emulated::gige_vision::{self, ADDRESS};
use uvcam_shm_ipc::{FrameHeader, PixelFormat, monotonic_ns};
use uvcam_tests::network::enter_namespace;
use uvcam_tests::{SharedMemory, open_aravis};

const WIDTH: u32 = 752;
const HEIGHT: u32 = 480;
const FPS: f64 = 60.0;
const FRAMES: u64 = 300;
const ROUNDS: usize = 3;
const SLOTS: usize = 6;
const PATIENCE: Duration = Duration::from_secs(2);

/// When the last trailer of a frame came by, CLOCK_MONOTONIC in ns.
static LAST_TRAILER_NS: AtomicU64 = AtomicU64::new(0);

#[derive(Default)]
struct Row {
    latencies_ns: Vec<u64>,
    lost: u64,
}

fn main() {
    enter_namespace();
    std::thread::spawn(see_trailers);
    let _camera = gige_vision::Camera::start("BENCH", 0);
    let [mut packet, mut plain, mut ours] = [(); 3].map(|()| Row::default());
    for _ in 0..ROUNDS {
        with_library(GvStreamOption::NONE, &mut packet);
        with_library(GvStreamOption::PACKET_SOCKET_DISABLED, &mut plain);
        with_uvcam(&mut ours);
    }
    let rows =
        [("library, packet socket", packet), ("library, plain socket", plain), ("uvcam, to sent", ours)];
    println!("{:24} p50 us  p99 us  lost of {}", "last packet to frame", FRAMES * ROUNDS as u64);
    for (name, mut row) in rows {
        row.latencies_ns.sort_unstable();
        let at = |part: f64| {
            row.latencies_ns[((row.latencies_ns.len() - 1) as f64 * part) as usize] as f64 / 1000.0
        };
        println!("{name:24} {:6.0}  {:6.0}  {:4}", at(0.5), at(0.99), row.lost);
    }
}

/// Watches all packets of loopback for the end of a frame: GVSP, packet format 2 (GigE Vision 2.0, 24.1).
fn see_trailers() {
    Realtime { priority: 50, cpus: Vec::new() }.apply("the watch for packets");
    let ip = NonZeroU32::new(u32::from(0x0800_u16.to_be())).map(Protocol::from_raw);
    let socket = socket_with(AddressFamily::PACKET, SocketType::DGRAM, SocketFlags::CLOEXEC, ip)
        .expect("packet sockets need CAP_NET_RAW");
    let mut packet = [0; 64];
    loop {
        let (length, _) = recv(&socket, &mut packet[..], RecvFlags::empty()).unwrap();
        let seen_ns = monotonic_ns();
        // A trailer is a short datagram: IPv4 without options, UDP, then status, block id and the packet's format.
        let is_control = packet[20..24].chunks(2).any(|port| port == 3956_u16.to_be_bytes());
        if length < 64 && packet[9] == 17 && !is_control && packet[32] & 0x7f == 2 {
            LAST_TRAILER_NS.store(seen_ns, Ordering::Relaxed);
        }
    }
}

fn since_trailer() -> u64 {
    monotonic_ns().saturating_sub(LAST_TRAILER_NS.load(Ordering::Relaxed))
}

fn with_library(options: GvStreamOption, row: &mut Row) {
    let camera = aravis::Camera::new(Some(ADDRESS)).unwrap();
    camera.set_region(0, 0, WIDTH as i32, HEIGHT as i32).unwrap();
    camera.set_frame_rate(FPS).unwrap();
    camera.gv_set_stream_options(options);
    let stream = camera.create_stream().unwrap();
    (0..SLOTS).for_each(|_| stream.push_buffer(Buffer::new_allocate((WIDTH * HEIGHT) as usize)));
    camera.start_acquisition().unwrap();
    let (mut first, mut whole) = (None, 0);
    loop {
        let buffer = stream.timeout_pop_buffer(PATIENCE.as_micros() as u64).expect("a frame");
        let latency_ns = since_trailer();
        if buffer.status() == BufferStatus::Success {
            let id = buffer.frame_id();
            // 16 bits without 0.
            let frame = (id + 65535 - *first.get_or_insert(id)) % 65535;
            if frame >= FRAMES {
                break;
            }
            row.latencies_ns.push(latency_ns);
            whole += 1;
        }
        stream.push_buffer(buffer);
    }
    row.lost += FRAMES - whole;
    camera.stop_acquisition().unwrap();
}

fn with_uvcam(row: &mut Row) {
    let settings = Settings::new(WIDTH, HEIGHT, FPS, 1000.0);
    let memory = SharedMemory::new();
    let mut camera = open_aravis(ADDRESS).unwrap();
    let applied = camera.configure(&settings).unwrap();
    let mut publisher = memory.publisher("bench", applied.payload_bytes, SLOTS);
    (0..SLOTS).for_each(|_| camera.queue(publisher.loan().unwrap()).unwrap());
    camera.start().unwrap();
    let mut header = FrameHeader::new(WIDTH, HEIGHT, WIDTH, PixelFormat::Mono8);
    let mut whole = 0;
    loop {
        match camera.next(PATIENCE).unwrap() {
            Event::Complete(capture) if capture.frame_id >= FRAMES => break,
            Event::Complete(capture) => {
                publisher.publish(capture.slot, &header).unwrap();
                row.latencies_ns.push(since_trailer());
                header.sequence += 1;
                whole += 1;
                camera.queue(publisher.loan().unwrap()).unwrap();
            }
            Event::Incomplete(slot) => camera.queue(slot).unwrap(),
            Event::Timeout => panic!("the camera stopped"),
        }
    }
    row.lost += FRAMES - whole;
}
