//! Generate-mode: the frame path with another ending. Lit frames go to the mask's generator instead of to consumers.
//!
//! A camera's thread walks it between two epochs of its stream. What follows (files, answers) is other threads' work; they get the
//! [`Order`] back when the camera has its flight settings again. Lit frames are no part of a stream: no consumer has lost them.

use std::fmt;
use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use uvcam_masker::GrayImage;
use uvcam_shm_ipc::{PixelFormat, Publisher, Slot, monotonic_ns};

use crate::camera::{Applied, Camera, CameraError, Event, Identity, Settings};
use crate::config::Generate;
use crate::error::Error;
use crate::generator::{Generator, Progress, Wish};

/// Longest wait for a frame before the thread looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(100);
/// A camera that delivers nothing for this long, and for three frame periods, has failed.
const SILENCE_NS: u64 = 2_000_000_000;
/// The lamp has to move between frames: more of them a second show the same.
const FPS: f64 = 10.0;
/// What may be asked for, as in the configuration: exposure times in microseconds, gains in decibels, frames.
const EXPOSURES_US: RangeInclusive<f64> = 1.0..=1e7;
const GAINS_DB: RangeInclusive<f64> = -40.0..=80.0;
const FRAMES: RangeInclusive<u32> = 1..=255;

/// Frames to be collected in another light than that of the flight.
pub struct Order {
    /// Exposure time in microseconds.
    pub exposure_us: f64,
    /// Gain in decibels.
    pub gain_db: f64,
    /// What takes the frames.
    pub generator: Generator,
    /// Called after each frame.
    pub progress: Box<dyn FnMut(Progress) + Send>,
    /// Set by whoever ordered, to be done with it early.
    pub cancelled: std::sync::Arc<AtomicBool>,
    /// Called with the generator when the camera has its flight settings again, or when it failed.
    pub done: Box<dyn FnOnce(Generator, Result<Light, Error>) + Send>,
}

/// Where lit frames came from, and in what light.
#[derive(Debug, Clone)]
pub struct Light {
    /// The camera.
    pub identity: Identity,
    /// What it applied, as read back.
    pub applied: Applied,
}

impl Light {
    /// Keywords and texts that tell of it, for the mask's file.
    pub fn provenance(&self) -> Vec<(&'static str, String)> {
        let Light { identity, applied } = self;
        vec![
            ("Camera", format!("{} {}", identity.vendor, identity.model)),
            ("Camera Serial", identity.serial.clone()),
            ("Size", format!("{}x{}", applied.width, applied.height)),
            ("Exposure us", applied.exposure_us.to_string()),
            ("Gain dB", applied.gain_db.to_string()),
        ]
    }
}

/// Exposure time in microseconds and gain in decibels of the lit frames that are wished for.
///
/// # Errors
/// [`Error::Usage`] where one of them, or the number of frames, is out of its range.
pub fn light(wish: &Wish, configured: &Generate) -> Result<(f64, f64), Error> {
    let exposure_us = wish.exposure_us.unwrap_or(configured.exposure_us);
    let gain_db = wish.gain_db.unwrap_or(configured.gain_db);
    check("exposure_us", &exposure_us, &EXPOSURES_US)?;
    check("gain_db", &gain_db, &GAINS_DB)?;
    check("frames", &wish.frames, &FRAMES)?;
    Ok((exposure_us, gain_db))
}

fn check<T: PartialOrd + fmt::Display>(
    name: &str,
    value: &T,
    allowed: &RangeInclusive<T>,
) -> Result<(), Error> {
    if allowed.contains(value) {
        return Ok(());
    }
    let (least, most) = (allowed.start(), allowed.end());
    Err(Error::Usage(format!("{name} = {value} refused: ask for {least} to {most}")))
}

impl fmt::Debug for Order {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Order")
            .field("exposure_us", &self.exposure_us)
            .field("gain_db", &self.gain_db)
            .finish_non_exhaustive()
    }
}

impl Order {
    /// The settings of the flight in the light of this order, at a rate that leaves the exposure room.
    pub fn settings(&self, flight: &Settings) -> Settings {
        let fps = flight.fps.min(FPS).min(0.5e6 / self.exposure_us);
        Settings { exposure_us: self.exposure_us, gain_db: self.gain_db, fps, ..flight.clone() }
    }

    /// Collects frames until the generator has seen enough, the order is cancelled, or `stop` is set. Returns their light.
    /// The camera is left stopped, with the order's settings.
    ///
    /// # Errors
    /// [`Error::Camera`] where the camera refuses the settings or fails; [`Error::Loan`] where no slot is free; [`Error::Generate`]
    /// where the generator takes no frames.
    pub fn collect(
        &mut self,
        camera: &mut dyn Camera,
        flight: &Settings,
        publisher: &Publisher,
        slots: usize,
        stop: &AtomicBool,
    ) -> Result<Light, Error> {
        let applied = camera.configure(&self.settings(flight))?;
        for _ in 0..slots {
            camera.queue(publisher.loan()?)?;
        }
        camera.start()?;
        let patience_ns = SILENCE_NS.max((3e9 / applied.fps) as u64);
        let mut last_frame_ns = monotonic_ns();
        // Relaxed: the flags carry no data, and are seen within one `PATIENCE`.
        while !stop.load(Ordering::Relaxed) && !self.cancelled.load(Ordering::Relaxed) {
            match camera.next(PATIENCE)? {
                Event::Complete(mut capture) => {
                    last_frame_ns = capture.arrival_monotonic_ns;
                    let frame = picture(&mut capture.slot, &applied);
                    camera.queue(capture.slot)?;
                    self.generator.add(frame)?;
                    (self.progress)(self.generator.progress());
                    if self.generator.is_satisfied() {
                        break;
                    }
                }
                Event::Incomplete(slot) => camera.queue(slot)?,
                Event::Timeout if monotonic_ns().saturating_sub(last_frame_ns) > patience_ns => {
                    return Err(CameraError::Device {
                        serial: camera.identity().serial.clone(),
                        doing: "collecting lit frames",
                        cause: format!("no frame for {:.1} s", patience_ns as f64 * 1e-9),
                    }
                    .into());
                }
                Event::Timeout => {}
            }
        }
        camera.stop();
        Ok(Light { identity: camera.identity().clone(), applied })
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A wish as a command may send it: not checked by a command line.
    fn wish(keys: &str) -> Wish {
        let text = format!("{{\"method\":\"fused\",\"ignore\":[],\"replace\":false{keys}}}");
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    fn light_out_of_range_is_refused_by_its_name() {
        let light = |keys: &str| light(&wish(keys), &Generate::default());
        assert!(light(",\"frames\":1").is_ok());
        let wrong = [
            (",\"frames\":8,\"exposure_us\":-5.0", "exposure_us = -5 refused: ask for 1 to 10000000"),
            (",\"frames\":8,\"exposure_us\":1e300", "exposure_us = 1"),
            (",\"frames\":8,\"gain_db\":81", "gain_db = 81 refused: ask for -40 to 80"),
            (",\"frames\":0", "frames = 0 refused: ask for 1 to 255"),
            (",\"frames\":256", "frames = 256 refused"),
        ];
        for (keys, expected) in wrong {
            let error = light(keys).unwrap_err();
            assert!(error.to_string().starts_with(expected), "{error}");
            assert_eq!(error.exit(), crate::exit::Exit::Usage);
        }
        let unknown = Wish { exposure_us: Some(f64::NAN), ..wish(",\"frames\":8") };
        assert!(super::light(&unknown, &Generate::default()).is_err());
    }
}
