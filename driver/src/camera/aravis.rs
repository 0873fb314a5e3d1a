//! USB3 Vision and GigE Vision cameras, through the library aravis (0.8.20 or later).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{GvDevice, UvUsbMode};
use uvcam_shm_ipc::Slot;

use super::{Applied, Camera, CameraError, Capture, Event, Identity, Settings};
use crate::clock::DeviceClock;
use crate::told::OPENING;
use features::{Features, failed};
use frame_id::FrameIdUnwrapper;
use stream::SlotStream;

mod configure;
mod discovery;
mod features;
mod finder;
mod frame_id;
mod gige;
mod log;
mod stream;
mod usb;

pub(super) use finder::Finder;
pub(super) use log::log_library;

const KIND: &str = "aravis";

/// All connected USB3 Vision and GigE Vision cameras. Takes about a second, for which every network interface is asked.
///
/// A USB camera is listed only where the access rights let the driver open it.
pub(super) fn list() -> Vec<Identity> {
    discovery::list()
}

/// An opened camera.
pub(super) struct AravisCamera {
    // Dropped first: its slots must not outlive the stream, nor the stream its camera.
    slots: SlotStream,
    camera: aravis::Camera,
    identity: Identity,
    /// Set by a thread of the library when the device is gone.
    control_lost: Arc<AtomicBool>,
    payload_bytes: usize,
    frame_ids: FrameIdUnwrapper,
    /// Ticks a second of the device's clock; 0 where it has none.
    tick_frequency_hz: f64,
    tells_temperature: bool,
}

impl AravisCamera {
    /// Opens the camera whose serial, device id (`Vendor-Model-Serial`) or IPv4 address is `serial`. An address is opened
    /// directly; anything else is looked for on USB first, then on the network, which takes a second. `Fake_1` is the library's
    /// camera in this process.
    ///
    /// # Errors
    /// [`CameraError::Absent`] with what was found instead; [`CameraError::Device`] where another program controls it.
    fn open(serial: &str) -> Result<Self, CameraError> {
        Ok(AravisCamera::of(discovery::open(serial)?))
    }

    fn of(opened: discovery::Opened) -> Self {
        let discovery::Opened { camera, identity } = opened;
        let control_lost = Arc::new(AtomicBool::new(false));
        // USB3 Vision counts nanoseconds.
        let mut tick_frequency_hz = 1e9;
        if let Some(device) = camera.device() {
            let flag = Arc::clone(&control_lost);
            // On a thread of the library: nothing but the flag. Relaxed, as it carries no data.
            device.connect_control_lost(move |_| flag.store(true, Ordering::Relaxed));
            if let Some(device) = device.downcast_ref::<GvDevice>() {
                // Without a frequency the library stamps with the host's clock instead.
                tick_frequency_hz =
                    device.timestamp_tick_frequency().map_or(0.0, |frequency| frequency as f64);
            }
        }
        let tells_temperature = camera.is_feature_available("DeviceTemperature").unwrap_or(false);
        AravisCamera {
            slots: SlotStream::default(),
            camera,
            identity,
            control_lost,
            payload_bytes: 0,
            frame_ids: FrameIdUnwrapper::default(),
            tick_frequency_hz,
            tells_temperature,
        }
    }

    fn is_gone(&self) -> bool {
        self.control_lost.load(Ordering::Relaxed)
    }

    fn disconnected(&self, doing: &'static str) -> CameraError {
        CameraError::Disconnected { serial: self.identity.serial.clone(), doing }
    }

    fn failed(&self, doing: &'static str, error: aravis::glib::Error) -> CameraError {
        match self.is_gone() {
            true => self.disconnected(doing),
            false => failed(&self.identity.serial, doing, error),
        }
    }
}

impl Camera for AravisCamera {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn device_clock(&self) -> DeviceClock {
        match self.tick_frequency_hz > 0.0 {
            true => DeviceClock::Own { increment_ns: 1e9 / self.tick_frequency_hz },
            false => DeviceClock::default(),
        }
    }

    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        let features = Features { camera: &self.camera, serial: &self.identity.serial };
        let applied = configure::configure(&features, settings).map_err(|error| match error {
            CameraError::Device { doing, .. } if self.is_gone() => self.disconnected(doing),
            error => error,
        })?;
        self.payload_bytes = applied.payload_bytes;
        Ok(applied)
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.slots.queue(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        if self.camera.is_uv_device() {
            // Up to 0.8.28, the asynchronous mode takes a whole processor core while no slot is queued.
            self.camera.uv_set_usb_mode(UvUsbMode::Sync);
        }
        if self.camera.is_gv_device() {
            gige::prepare(&self.camera, &self.identity.serial, self.payload_bytes);
        }
        let stream = self.camera.create_stream().map_err(|error| self.failed("starting", error))?;
        gige::tune(&stream, self.payload_bytes);
        if let Some(bytes) = gige::packet_bytes(&self.camera) {
            let serial = &self.identity.serial;
            tracing::info!(target: OPENING, "camera {serial}: frames come in packets of {bytes} bytes");
        }
        self.frame_ids = FrameIdUnwrapper::default();
        self.slots.start(stream);
        self.camera.start_acquisition().map_err(|error| self.failed("starting", error))
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        if self.is_gone() {
            return Err(self.disconnected("streaming"));
        }
        let Some(filled) = self.slots.next(timeout) else {
            return match self.is_gone() {
                true => Err(self.disconnected("streaming")),
                false => Ok(Event::Timeout),
            };
        };
        let Some(frame) = filled.frame else {
            return Ok(Event::Incomplete(filled.slot));
        };
        Ok(Event::Complete(Capture {
            slot: filled.slot,
            frame_id: self.frame_ids.unwrap(frame.id),
            device_timestamp_ns: (self.tick_frequency_hz > 0.0).then_some(frame.timestamp_ns),
            arrival_monotonic_ns: filled.arrival_monotonic_ns,
        }))
    }

    fn temperature_c(&mut self) -> Option<f64> {
        if !self.tells_temperature || self.is_gone() {
            return None;
        }
        let told = self.camera.float("DeviceTemperature").ok();
        // One that does not answer is not asked again: the library would wait seconds for it.
        self.tells_temperature = told.is_some();
        told
    }

    fn stop(&mut self) {
        // A device that is gone is not waited for. What fails is made up for: the end of the stream stops the transfer, the next
        // configuration the acquisition.
        if self.slots.is_started() && !self.is_gone() {
            let _ = self.camera.stop_acquisition();
        }
        self.slots.stop();
    }
}

impl Drop for AravisCamera {
    fn drop(&mut self) {
        self.stop();
    }
}
