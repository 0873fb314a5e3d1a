//! The way of one frame: complete in its slot, masked there, stamped, sent.
//!
//! Laws of this path, from "complete" to "sent", each with a test of its name in `tests/laws.rs` or `tests/loss.rs`:
//! - no allocation, no copy of pixels, no log, no wait for a consumer;
//! - a frame that is not whole, or not masked as configured, is never sent;
//! - what the device is known to have produced and this stream did not publish is counted as soon as it is known, and the next
//!   header tells, be it of this epoch or of a later one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use uvcam_masker::ImageViewMut;
use uvcam_shm_ipc::{FrameHeader, Publisher, Slot, monotonic_ns};

use crate::camera::{Applied, Camera, CameraError, Capture, Event};
use crate::clock::FrameClock;
use crate::counters::{Counters, add};
use crate::error::Error;
use crate::generate::Task;
use crate::mask::{self, MaskInForce};

mod stall;

use stall::StallDetector;

/// Longest wait for a frame before the thread looks at its commands.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time between readings of the device's temperature, each of which takes a millisecond.
const TEMPERATURE_PERIOD_NS: u64 = 10_000_000_000;

/// What another thread may ask of the path; taken at a frame boundary.
#[derive(Debug)]
pub enum Command {
    /// Fly this mask, which consumers were given, from the next frame on.
    Mask(MaskInForce),
    /// Leave the path and collect lit frames.
    Generate(Box<Task>),
    /// Leave the path for another publisher: consumers no longer find this one.
    Republish,
}

/// Why the path was left.
#[derive(Debug)]
pub enum Leave {
    /// The driver stops.
    Stop,
    /// Lit frames are to be collected.
    Generate(Box<Task>),
    /// Another publisher is to be made.
    Republish,
}

/// One camera, its publisher and its mask, for the time of one epoch.
pub struct FramePath<'a> {
    /// An opened and configured camera.
    pub camera: &'a mut dyn Camera,
    /// What it reads back.
    pub applied: &'a Applied,
    /// Where frames go.
    pub publisher: &'a mut Publisher,
    /// What is blanked, or travels beside the frames; a command may change it.
    pub mask: &'a mut MaskInForce,
    /// What other threads ask for.
    pub commands: &'a Receiver<Command>,
    /// What other threads read.
    pub counters: &'a Counters,
    /// What stays the same over the epoch, with room for the next frame's stamps.
    pub header: FrameHeader,
    /// How long the camera may take to its first frame, where that is longer than it may fall silent later.
    pub first_frame_patience: Duration,
    /// How many slots the camera fills in turn.
    pub slots: usize,
    /// Where the stream stands; starts at its default.
    pub position: Position,
}

/// How far a stream has come.
#[derive(Debug, Default)]
pub struct Position {
    /// Slots that the camera holds.
    queued: usize,
    last_whole_id: Option<u64>,
    /// Frames that came incomplete since: they are counted already.
    incomplete: u64,
    clock: FrameClock,
    next_temperature_ns: u64,
}

impl Position {
    /// Frames that the device produced before the one with this id and that nobody has counted yet; `None` where ids do not grow: the
    /// device was reset, and what it lost by that is not known.
    #[inline]
    fn gap_before(&self, frame_id: u64) -> Option<u64> {
        let missing = match self.last_whole_id {
            None => frame_id,
            Some(last) => frame_id.checked_sub(last)?.checked_sub(1)?,
        };
        // An incomplete frame has no id of its own, but a place among the missing ones, unless the device does not count.
        Some(missing.saturating_sub(self.incomplete))
    }
}

impl FramePath<'_> {
    /// Walks until `stop` is set, the camera fails, or a command asks to leave. `streaming` is called when the first frame is about to go
    /// out.
    ///
    /// # Errors
    /// What ended the epoch. The camera is to be dropped.
    pub fn run(&mut self, stop: &AtomicBool, streaming: impl FnOnce()) -> Result<Leave, Error> {
        add(&self.counters.epochs, 1);
        self.counters.set_mask_id(self.mask.as_deref().map(|mask| mask.id()));
        self.fill_queue()?;
        self.camera.start()?;
        let mut stall_detector = StallDetector::new(self.header.frame_period_ns, self.first_frame_patience);
        let mut streaming = Some(streaming);
        // Relaxed: the flag carries no data, and is seen within one `PATIENCE`.
        while !stop.load(Ordering::Relaxed) {
            self.counters.live();
            if let Some(leave) = self.take_commands() {
                self.camera.stop();
                return Ok(leave);
            }
            match self.camera.next(PATIENCE)? {
                Event::Complete(capture) => {
                    let arrival_ns = capture.arrival_monotonic_ns;
                    stall_detector.saw_whole_frame(arrival_ns);
                    self.position.queued -= 1;
                    // Before the frame is sent: whoever has seen it may rely on the driver's state.
                    if let Some(streaming) = streaming.take() {
                        streaming();
                    }
                    self.publish(capture).inspect_err(|_| self.lose(1))?;
                    self.take_temperature(arrival_ns);
                }
                Event::Incomplete(slot) => {
                    self.lose(1);
                    self.position.incomplete += 1;
                    add(&self.counters.incomplete, 1);
                    self.camera.queue(slot)?;
                    stall_detector.check(self.camera.identity(), 1)?;
                }
                Event::Timeout => stall_detector.check(self.camera.identity(), 0)?,
            }
            self.fill_queue()?;
        }
        self.camera.stop();
        Ok(Leave::Stop)
    }

    fn publish(&mut self, capture: Capture) -> Result<(), Error> {
        let Capture { mut slot, frame_id, device_timestamp_ns, arrival_monotonic_ns } = capture;
        let Some(gap) = self.position.gap_before(frame_id) else {
            let last = self.position.last_whole_id.unwrap_or_default();
            return Err(self.failed(format!("frame id {frame_id} follows {last}")).into());
        };
        if gap > 0 {
            self.lose(gap);
        }
        if self.position.last_whole_id.is_none() {
            self.position.clock = FrameClock::new(self.camera.device_clock());
        }
        self.position.last_whole_id = Some(frame_id);
        self.position.incomplete = 0;
        self.apply_mask(&mut slot)?;
        let masked_ns = monotonic_ns();
        self.header.device_frame_id = frame_id;
        self.header.arrival_monotonic_ns = arrival_monotonic_ns;
        self.position.clock.stamp(&mut self.header, device_timestamp_ns);
        self.publisher.publish(slot, &self.header)?;
        let sent_ns = monotonic_ns();
        // A scheduler tends to wake consumers on this core: they go before what can wait.
        std::thread::yield_now();
        self.position.clock.learn();
        self.counters.arrival_to_masked.record(masked_ns.saturating_sub(arrival_monotonic_ns));
        self.counters.masked_to_sent.record(sent_ns.saturating_sub(masked_ns));
        self.header.sequence += 1;
        add(&self.counters.published, 1);
        Ok(())
    }

    /// Counts frames that the device produced and that will not be published.
    fn lose(&mut self, frames: u64) {
        self.publisher.count_lost(frames);
        add(&self.counters.lost, frames);
    }

    fn apply_mask(&mut self, slot: &mut Slot) -> Result<(), Error> {
        let Some(mask) = self.mask.as_deref() else { return Ok(()) };
        let Applied { width, height, stride, pixel_format, .. } = *self.applied;
        let mut image = ImageViewMut::new(
            slot.pixels_mut(),
            width,
            height,
            stride as usize,
            pixel_format.bytes_per_pixel(),
        )?;
        Ok(mask.apply(&mut image)?)
    }

    /// Asks the device right after a frame was sent, when the next one is farthest.
    fn take_temperature(&mut self, now_ns: u64) {
        if now_ns >= self.position.next_temperature_ns {
            self.position.next_temperature_ns = now_ns.saturating_add(TEMPERATURE_PERIOD_NS);
            self.counters.set_temperature_c(self.camera.temperature_c());
        }
    }

    /// Hands free slots to the camera until it holds all that it may.
    fn fill_queue(&mut self) -> Result<(), Error> {
        while self.position.queued < self.slots {
            match self.publisher.loan() {
                Ok(slot) => {
                    self.camera.queue(slot)?;
                    self.position.queued += 1;
                }
                // A camera that still holds one can go on; the next frame boundary tries again.
                Err(_) if self.position.queued > 0 => {
                    add(&self.counters.no_free_slot, 1);
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    fn take_commands(&mut self) -> Option<Leave> {
        while let Ok(command) = self.commands.try_recv() {
            match command {
                Command::Mask(mask) => {
                    mask::mark(&mut self.header, &mask);
                    self.counters.set_mask_id(mask.as_deref().map(|mask| mask.id()));
                    *self.mask = mask;
                }
                Command::Generate(task) => return Some(Leave::Generate(task)),
                Command::Republish => return Some(Leave::Republish),
            }
        }
        None
    }

    fn failed(&self, cause: String) -> CameraError {
        CameraError::Device { serial: self.camera.identity().serial.clone(), doing: "streaming", cause }
    }
}

#[cfg(test)]
pub(crate) mod tests;
