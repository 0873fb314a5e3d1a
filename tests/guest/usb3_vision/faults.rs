//! What a camera does wrong, one by one, on a driver that runs all the time.

use std::time::{Duration, Instant};

use uvcam_emulated::scene::picture;
use uvcam_emulated::usb::Plugged;
use uvcam_emulated::usb3_vision::{Camera, Fault, Identity};
use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::Subscriber;
use uvcam_tests::{Process, Stage, next_frame, wait_until};

use super::{BYTES, SIZE, camera};

const SERIAL: &str = "U3V1";
/// Longest time from the return of a device to its first good frame. The guest's clock counts instructions: it can be relied on.
const RECOVERY: Duration = Duration::from_secs(1);

/// One camera, one driver, and a consumer that looks at every frame.
struct Bench {
    device: Option<Plugged<Camera>>,
    subscriber: Subscriber,
    mask: Mask,
    _driver: Process,
    _stage: Stage,
}

/// What a consumer saw of a fault.
struct Seen {
    lost: u64,
    new_epochs: u64,
    recovery: Duration,
}

impl Bench {
    fn new() -> Self {
        let stage = Stage::new(&camera("left", SERIAL));
        let mask = stage.write_mask("mask.png", SIZE, 100);
        let subscriber = stage.subscriber("left");
        let device = Some(plug(SERIAL, None));
        let driver = stage.driver();
        let mut bench = Bench { device, subscriber, mask, _driver: driver, _stage: stage };
        bench.frames(30);
        bench
    }

    /// Takes frames, each of which must be whole and masked. Frames that the device numbers as it should are compared with what it
    /// drew.
    fn frames(&mut self, count: usize) {
        for _ in 0..count {
            let frame = next_frame(&mut self.subscriber);
            let header = frame.header();
            let image = ImageView::new(frame.pixels(), SIZE.0, SIZE.1, header.stride as usize, 1).unwrap();
            assert_eq!(self.mask.masked_nonzero(&image).unwrap(), 0);
            let first = u64::from(frame.pixels()[0]) - 1;
            let kept = BYTES - 100 * SIZE.0 as usize;
            assert!(frame.pixels()[..kept] == picture(first, BYTES)[..kept], "a frame made of two");
        }
    }

    /// Lets `fault` happen, which returns when the device is well again, and watches until the consumer has noticed and the stream
    /// has run on for a while.
    fn watch(&mut self, fault: impl FnOnce(&mut Self) -> Instant) -> Seen {
        let (lost, epochs) = (self.subscriber.lost(), self.subscriber.epochs());
        let well = fault(self);
        while (self.subscriber.lost(), self.subscriber.epochs()) == (lost, epochs) {
            self.frames(1);
        }
        let recovery = well.elapsed();
        self.frames(30);
        Seen { lost: self.subscriber.lost() - lost, new_epochs: self.subscriber.epochs() - epochs, recovery }
    }

    fn fail(&mut self, fault: Fault) -> Instant {
        self.device.as_ref().unwrap().device().fail(fault);
        Instant::now()
    }

    fn replug(&mut self, fault: Option<Fault>) -> Instant {
        self.device = None;
        let device = self.device.insert(plug(SERIAL, fault));
        let well = Instant::now();
        // A camera that does not take a setting is well when it has done so.
        wait_until("the fault has happened", || device.device().has_failed());
        if matches!(fault, Some(Fault::RefusedWrite(_) | Fault::IgnoredWrite(_))) {
            Instant::now()
        } else {
            well
        }
    }
}

fn plug(serial: &str, fault: Option<Fault>) -> Plugged<Camera> {
    let mut camera = Camera::new(Identity::with_serial(serial));
    fault.into_iter().for_each(|fault| camera.fail(fault));
    Plugged::new(camera)
}

fn print(fault: &str, seen: &Seen) {
    let saw = match seen.new_epochs {
        0 => "a gap".to_owned(),
        1 => "a new epoch".to_owned(),
        epochs => format!("{epochs} new epochs"),
    };
    println!("\n| {fault} | {saw} | {} | {:.2} |", seen.lost, seen.recovery.as_secs_f64());
}

#[test]
fn every_fault_is_survived() {
    let mut bench = Bench::new();
    println!("\n| USB3 Vision fault | consumer saw | lost | s to recovery |\n| --- | --- | --- | --- |");

    for (name, fault, lost) in [
        ("short payload", Fault::ShortPayload, 1),
        ("no trailer", Fault::NoTrailer, 1),
        ("3 frames not sent", Fault::FrameIdJump(3), 3),
        ("1000 frames not sent", Fault::FrameIdJump(1000), 1000),
    ] {
        let seen = bench.watch(|bench| bench.fail(fault));
        print(name, &seen);
        assert_eq!((seen.lost, seen.new_epochs), (lost, 0), "{name}");
        assert!(seen.recovery < RECOVERY, "{name}");
    }

    // Its ids begin anew: nothing tells how much was lost, but the frame that was cut off, where there was one.
    for (name, fault) in [("endpoint halts", Fault::StalledEndpoint), ("silence", Fault::Freeze)] {
        let seen = bench.watch(|bench| bench.fail(fault));
        print(name, &seen);
        assert!(seen.lost <= 1 && seen.new_epochs == 1, "{name}: {} lost", seen.lost);
        // A camera counts as silent after a second.
        assert!(seen.recovery < Duration::from_secs(1) + RECOVERY, "{name}");
    }

    for (name, fault) in [
        ("unplugged, plugged in again", None),
        ("the same, and a setting is refused", Some(Fault::RefusedWrite("ExposureTime"))),
        ("the same, and a setting is confirmed but not taken", Some(Fault::IgnoredWrite("ExposureTime"))),
        ("the same, with ids of 16 bits that wrap", Some(Fault::SixteenBitIds)),
    ] {
        let seen = bench.watch(|bench| bench.replug(fault));
        print(name, &seen);
        assert!(seen.lost <= 1 && seen.new_epochs == 1, "{name}: {} lost", seen.lost);
        assert!(seen.recovery < RECOVERY, "{name}");
    }
    // Past the wrap.
    let lost = bench.subscriber.lost();
    bench.frames(60);
    assert_eq!(bench.subscriber.lost(), lost, "the wrap of frame ids is not a loss");

    let seen = bench.watch(|bench| {
        bench.device = None;
        let other = plug("U3V9", None);
        // Long enough for the driver to look at it, and to leave it alone.
        std::thread::sleep(Duration::from_millis(500));
        assert!(!other.device().is_acquiring(), "another camera was taken for ours");
        bench.device = Some(plug(SERIAL, None));
        Instant::now()
    });
    print("another camera in its place, then itself", &seen);
    assert!(seen.lost <= 1 && seen.new_epochs == 1, "{} lost", seen.lost);
    assert!(seen.recovery < RECOVERY, "another camera in its place");
}
