//! Where lit frames are collected.

use std::time::Duration;

use uvcam_masker::GrayImage;
use uvcam_shm_ipc::control::Progress;
use uvcam_shm_ipc::{PixelFormat, Publisher, Slot, monotonic_ns};

use super::generator::Generator;
use super::light::Light;
use super::lit_frames::LitFrames;
use super::request::Request;
use crate::camera::{Applied, Camera, CameraError, Event, Settings};
use crate::counters::Counters;
use crate::error::Error;

/// Longest wait for a frame before the thread looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(100);
/// A camera that delivers nothing for this long, and for three frame periods, has failed.
const SILENCE_NS: u64 = 2_000_000_000;

/// A camera between two epochs, and the memory that its lit frames are written to.
pub struct Collector<'a> {
    /// The camera, stopped.
    pub camera: &'a mut dyn Camera,
    /// Its settings in flight.
    pub flight: &'a Settings,
    /// What lends slots; nothing is published.
    pub publisher: &'a Publisher,
    /// How many slots the camera fills in turn.
    pub slots: usize,
    /// Where other threads see that this one is not stuck.
    pub counters: &'a Counters,
}

impl Collector<'_> {
    /// Collects frames until they suffice, or `is_over`. `progress` is called after each of them. The camera is left stopped, with the
    /// request's settings.
    ///
    /// # Errors
    /// [`Error::Camera`] where the camera refuses the settings or fails; [`Error::Loan`] where no slot is free; [`Error::Generate`]
    /// where the generator takes no frames.
    pub fn run(
        &mut self,
        request: Request,
        is_over: impl Fn() -> bool,
        progress: impl Fn(Progress),
    ) -> Result<LitFrames, Error> {
        self.counters.live();
        let applied = self.camera.configure(&request.settings(self.flight))?;
        let mut generator = Generator::new(request);
        for _ in 0..self.slots {
            self.camera.queue(self.publisher.loan()?)?;
        }
        self.camera.start()?;
        let patience_ns = SILENCE_NS.max((3e9 / applied.fps) as u64);
        let mut last_frame_ns = monotonic_ns();
        while !is_over() {
            self.counters.live();
            match self.camera.next(PATIENCE)? {
                Event::Complete(mut capture) => {
                    last_frame_ns = capture.arrival_monotonic_ns;
                    let frame = picture(&mut capture.slot, &applied);
                    self.camera.queue(capture.slot)?;
                    generator.add(frame)?;
                    progress(generator.progress());
                    if generator.is_satisfied() {
                        break;
                    }
                }
                Event::Incomplete(slot) => self.camera.queue(slot)?,
                Event::Timeout if monotonic_ns().saturating_sub(last_frame_ns) > patience_ns => {
                    return Err(CameraError::Device {
                        serial: self.camera.identity().serial.clone(),
                        doing: "collecting lit frames",
                        cause: format!("no frame for {:.1} s", patience_ns as f64 * 1e-9),
                    }
                    .into());
                }
                Event::Timeout => {}
            }
        }
        self.camera.stop();
        let light = Light { identity: self.camera.identity().clone(), applied };
        Ok(LitFrames::new(generator, light))
    }
}

/// The frame in 8 bits, without row padding.
fn picture(slot: &mut Slot, applied: &Applied) -> GrayImage {
    let bytes_per_pixel = applied.pixel_format.bytes_per_pixel();
    let row_bytes = applied.width as usize * bytes_per_pixel;
    let rows = slot.pixels_mut().chunks(applied.stride as usize).take(applied.height as usize);
    let rows = rows.filter_map(|row| row.get(..row_bytes));
    let pixels: Vec<u8> = match applied.pixel_format {
        PixelFormat::Mono8 => rows.flatten().copied().collect(),
        wide => {
            let shift = wide.significant_bits() - 8;
            let values = rows.flat_map(|row| row.chunks_exact(2));
            values.map(|pixel| (u16::from_le_bytes([pixel[0], pixel[1]]) >> shift) as u8).collect()
        }
    };
    // A slot holds stride times height bytes, so there are enough pixels.
    GrayImage::from_raw(applied.width, applied.height, pixels).unwrap_or_default()
}
