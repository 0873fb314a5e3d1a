//! What a camera's thread knows and others want to know.
//!
//! Every value is written by the camera's thread alone and read for display: `Relaxed` on both sides.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use uvcam_masker::MaskId;
use uvcam_shm_ipc::Footing;

use crate::latency::LatencyHistogram;

/// Counters of one camera, since the driver started.
#[derive(Debug, Default)]
pub struct Counters {
    /// Frames sent.
    pub published: AtomicU64,
    /// Frames that the device is known to have produced and no stream published, for whatever reason.
    pub lost: AtomicU64,
    /// Frames that arrived with a part missing; they are among the lost.
    pub incomplete: AtomicU64,
    /// Times that no free slot was there for the camera to fill.
    pub no_free_slot: AtomicU64,
    /// Streams begun.
    pub epochs: AtomicU64,
    /// Streams, and attempts to open the camera, that ended in an error. Looks for a camera that is absent do not count.
    pub failures: AtomicU64,
    /// From the whole frame in memory to its mask applied.
    pub arrival_to_masked: LatencyHistogram,
    /// From the mask applied to the frame sent and sleeping consumers woken.
    pub masked_to_sent: LatencyHistogram,
    temperature: Temperature,
    signs_of_life: AtomicU64,
    /// Locked where the mask changes, which is between two frames, and for a copy of 16 bytes.
    mask_id: Mutex<Option<MaskId>>,
    /// Locked where another publisher is made, and once a second for a look at its files.
    footing: Mutex<Option<Footing>>,
}

/// Degrees Celsius, as the bits of an `f64`.
#[derive(Debug)]
struct Temperature(AtomicU64);

impl Default for Temperature {
    fn default() -> Self {
        Temperature(AtomicU64::new(f64::NAN.to_bits()))
    }
}

/// Adds to a counter.
pub fn add(counter: &AtomicU64, count: u64) {
    counter.fetch_add(count, Ordering::Relaxed);
}

impl Counters {
    /// Keeps the files that consumers find the publisher by; `None` while there is no publisher.
    pub fn set_footing(&self, footing: Option<Footing>) {
        *self.footing.lock().unwrap_or_else(PoisonError::into_inner) = footing;
    }

    /// Whether consumers no longer find the publisher. True once for each publisher.
    pub fn has_lost_footing(&self) -> bool {
        let mut footing = self.footing.lock().unwrap_or_else(PoisonError::into_inner);
        footing.take_if(|footing| !footing.is_in_place()).is_some()
    }

    /// Keeps the device's temperature in degrees Celsius, `None` where it tells none.
    pub fn set_temperature_c(&self, temperature: Option<f64>) {
        self.temperature.0.store(temperature.unwrap_or(f64::NAN).to_bits(), Ordering::Relaxed);
    }

    /// The device's temperature in degrees Celsius; NaN where it tells none.
    pub fn temperature_c(&self) -> f64 {
        f64::from_bits(self.temperature.0.load(Ordering::Relaxed))
    }

    /// Says that the camera's thread is not stuck.
    pub fn live(&self) {
        add(&self.signs_of_life, 1);
    }

    /// How often the camera's thread has said that it is not stuck.
    pub fn signs_of_life(&self) -> u64 {
        self.signs_of_life.load(Ordering::Relaxed)
    }

    /// Keeps the identity of the mask in force.
    pub fn set_mask_id(&self, id: Option<MaskId>) {
        *self.mask_id.lock().unwrap_or_else(PoisonError::into_inner) = id;
    }

    /// The identity of the mask in force; all zero where none is.
    pub fn mask_id(&self) -> MaskId {
        self.mask_id.lock().unwrap_or_else(PoisonError::into_inner).unwrap_or(MaskId::NONE)
    }
}
