//! Everything that vivid does wrong on command, one by one.

use uvcam_shm_ipc::{Subscriber, monotonic_ns};
use uvcam_tests::{Process, Stage, next_frame, stderr};
use v4l::Device;
use v4l::control::{Control, Value};

use super::{Expected, FPS, NODE, PERCENTAGE_DROPPED, SEQUENCE_WRAP, VIVID, camera, reset, set};

/// Buttons of vivid.
const DISCONNECT: u32 = VIVID + 65;
const BUFFER_ERROR: u32 = VIVID + 66;
pub(super) const REQBUFS_ERROR: u32 = VIVID + 67;
const QBUF_ERROR: u32 = VIVID + 68;
const STREAMON_ERROR: u32 = VIVID + 69;
const FATAL_ERROR: u32 = VIVID + 70;

/// Both ways of frames.
const MEMORIES: [&str; 2] = ["userptr", "mmap"];
/// The longest time from a fault to the next good frame, by the clock of the guest, which counts its instructions.
const RECOVERY_NS: u64 = 1_000_000_000;

pub(super) fn press(button: u32) {
    Device::with_path(NODE).unwrap().set_control(Control { id: button, value: Value::None }).unwrap();
}

/// A driver on a device, before or after a fault.
struct Flight {
    memory: &'static str,
    expected: Expected,
    subscriber: Subscriber,
    driver: Process,
    // Last: the others live in it.
    _stage: Stage,
}

impl Flight {
    /// Starts the driver; `before` happens to a device that stands still.
    fn start(memory: &'static str, before: impl FnOnce()) -> Self {
        reset();
        let stage = Stage::new(&camera(&format!("path = \"{NODE}\", memory = \"{memory}\""), "Mono8"));
        let expected = Expected::new(&stage, b"GREY", 1);
        before();
        let subscriber = stage.subscriber("left");
        Flight { memory, expected, subscriber, driver: stage.driver(), _stage: stage }
    }

    /// Takes frames until `enough` says so, and returns by how many ids the last lies behind the first. Every frame is good, and
    /// every id is that of a frame or counted as lost.
    fn take(&mut self, mut enough: impl FnMut(&Subscriber) -> bool) -> u64 {
        let counted = |subscriber: &Subscriber| subscriber.frames() + subscriber.lost();
        let mut first = None;
        loop {
            let frame = next_frame(&mut self.subscriber);
            self.expected.check(&frame);
            let id = frame.header().device_frame_id;
            let (first_id, before) = *first.get_or_insert((id, counted(&self.subscriber)));
            assert_eq!(counted(&self.subscriber) - before, id - first_id);
            if enough(&self.subscriber) {
                return id - first_id;
            }
        }
    }

    fn take_frames(&mut self, count: u64) -> u64 {
        let end = self.subscriber.frames() + count;
        self.take(|subscriber| subscriber.frames() >= end)
    }

    /// Prints what a consumer saw.
    fn report(self, fault: &str, seen: &str, recovery_ns: Option<u64>) {
        let recovery = recovery_ns.map_or("-".into(), |time| format!("{:.2}", time as f64 * 1e-9));
        println!("\n| vivid, {}: {fault} | {seen} | {} | {recovery} |", self.memory, self.subscriber.lost());
        let output = self.driver.stop();
        assert!(output.status.success(), "{}", stderr(&output));
    }

    /// Presses buttons, of which the last ends the stream, and takes frames of the next one.
    fn survive(mut self, buttons: &[u32], fault: &str) {
        self.take_frames(20);
        let pressed = monotonic_ns();
        buttons.iter().copied().for_each(press);
        let recovery_ns = loop {
            let frame = next_frame(&mut self.subscriber);
            self.expected.check(&frame);
            if frame.epoch_changed() {
                break frame.header().arrival_monotonic_ns - pressed;
            }
        };
        assert!(recovery_ns < RECOVERY_NS, "{fault}: {recovery_ns} ns");
        self.take_frames(20);
        assert_eq!((self.subscriber.lost(), self.subscriber.epochs()), (0, 2));
        self.report(fault, "a new epoch", Some(recovery_ns));
    }
}

#[test]
fn dropped_buffers_are_counted_by_their_sequence() {
    for memory in MEMORIES {
        let mut flight = Flight::start(memory, || set(PERCENTAGE_DROPPED, 30));
        let first = next_frame(&mut flight.subscriber);
        let (first_id, first_ns) = (first.header().device_frame_id, first.header().device_timestamp_ns);
        drop(first);
        flight.take_frames(199);
        let last = next_frame(&mut flight.subscriber);
        // The device's clock tells independently how many frames it was.
        let time_ns = (last.header().device_timestamp_ns - first_ns) as f64;
        let exposed = (time_ns * f64::from(FPS) * 1e-9).round() as u64;
        assert_eq!(last.header().device_frame_id - first_id, exposed);
        assert_eq!(flight.subscriber.lost(), exposed - 200);
        assert!(flight.subscriber.lost() > 20 && flight.subscriber.epochs() == 1);
        drop(last);
        flight.report("30 % of buffers dropped", "gaps", None);
    }
}

#[test]
fn a_damaged_buffer_is_one_lost_frame() {
    for memory in MEMORIES {
        let mut flight = Flight::start(memory, || ());
        for button in 1..=3 {
            flight.take_frames(10);
            press(BUFFER_ERROR);
            flight.take(|subscriber| subscriber.lost() >= button);
            flight.take_frames(10);
            assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (button, 1));
        }
        flight.report("3 buffers with the ERROR flag", "gaps", None);
    }
}

#[test]
fn sequence_numbers_wrap_without_a_gap() {
    for memory in MEMORIES {
        let mut flight = Flight::start(memory, || set(SEQUENCE_WRAP, 1));
        // The device starts 128 frames before the wrap.
        assert_eq!(flight.take_frames(200), 199);
        assert_eq!((flight.subscriber.lost(), flight.subscriber.epochs()), (0, 1));
        flight.report("sequence wrap", "nothing", None);
    }
}

#[test]
fn a_refused_buffer_ends_the_epoch() {
    for memory in MEMORIES {
        Flight::start(memory, || ()).survive(&[QBUF_ERROR], "VIDIOC_QBUF fails");
    }
}

#[test]
fn a_fatal_error_ends_the_epoch() {
    for memory in MEMORIES {
        Flight::start(memory, || ()).survive(&[FATAL_ERROR], "VIDIOC_DQBUF fails with EIO");
    }
}

#[test]
fn a_disconnected_device_is_opened_again() {
    for memory in MEMORIES {
        Flight::start(memory, || ()).survive(&[DISCONNECT], "disconnect");
    }
}

#[test]
fn a_failing_start_is_tried_again() {
    for memory in MEMORIES {
        for (button, fault) in [(REQBUFS_ERROR, "VIDIOC_REQBUFS"), (STREAMON_ERROR, "VIDIOC_STREAMON")] {
            let fault = format!("EIO, then {fault} fails");
            Flight::start(memory, || ()).survive(&[button, FATAL_ERROR], &fault);
        }
    }
}
