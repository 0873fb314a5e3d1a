//! What the driver tells of a camera, over its health service.

use std::sync::atomic::{AtomicU64, Ordering};

use rustix::time::{ClockId, clock_gettime};
use uvcam_masker::MaskId;
use uvcam_shm_ipc::Footing;
use uvcam_shm_ipc::health::{Cause, Health, HealthPublisher, MaskMode};
use uvcam_shm_ipc::{IpcError, monotonic_ns};

use crate::camera::CameraError;
use crate::config::{self, CameraConfig, Config};
use crate::counters::Counters;
use crate::error::{Error, with_causes};
use crate::supervise::State;

/// Keeps the record of one camera.
pub struct Reporter {
    /// Missing where its files were removed and could not be made anew yet.
    publisher: Option<HealthPublisher>,
    record: Health,
    /// Of a mask, where there is one.
    mask_mode: MaskMode,
}

impl Reporter {
    /// Begins the record of a camera that has not been opened.
    ///
    /// # Errors
    /// [`IpcErrorKind::AlreadyPublishing`](uvcam_shm_ipc::IpcErrorKind::AlreadyPublishing) where another driver tells of this camera, and those of [`HealthPublisher::create`].
    pub fn open(config: &Config, camera: &CameraConfig) -> Result<Self, IpcError> {
        let publisher = Some(HealthPublisher::create(&config.ipc.settings, &camera.name)?);
        let now_ns = monotonic_ns();
        let mut record = Health::new();
        record.started_monotonic_ns = now_ns;
        record.state_since_monotonic_ns = now_ns;
        record.process_id = std::process::id();
        record.config_digest = config.digest;
        let mask_mode = match camera.mask_mode {
            config::MaskMode::Blank => MaskMode::Blank,
            config::MaskMode::Attach => MaskMode::Attach,
        };
        Ok(Reporter { publisher, record, mask_mode })
    }

    /// Takes a change of state into the record.
    pub fn set_state(&mut self, state: &State) {
        let code = match state {
            State::Streaming(_) => uvcam_shm_ipc::health::State::Streaming,
            State::Generating => uvcam_shm_ipc::health::State::Generating,
            State::Waiting(_) => uvcam_shm_ipc::health::State::Reconnecting,
            State::Refused(_) => uvcam_shm_ipc::health::State::Refused,
        };
        self.enter(code);
        if let State::Waiting(error) | State::Refused(error) = state {
            self.record.cause = cause(error) as u32;
            self.record.set_last_error(&with_causes(error));
        }
    }

    /// Says that nothing was heard of the camera's thread.
    pub fn set_stuck(&mut self, text: &str) {
        self.enter(uvcam_shm_ipc::health::State::Reconnecting);
        self.record.cause = Cause::Stuck as u32;
        self.record.set_last_error(text);
    }

    /// Says that the driver ends.
    pub fn set_stopped(&mut self) {
        self.enter(uvcam_shm_ipc::health::State::Stopped);
    }

    fn enter(&mut self, state: uvcam_shm_ipc::health::State) {
        if self.record.state != state as u32 {
            self.record.state = state as u32;
            self.record.state_since_monotonic_ns = monotonic_ns();
        }
    }

    /// Keeps the frames published a second.
    pub fn set_frame_rate(&mut self, frame_rate: f64) {
        self.record.frame_rate = frame_rate;
    }

    /// Publishes the record with the counters as they are. What fails is told in the log: a camera flies on without its record.
    pub fn publish(&mut self, counters: &Counters) {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let record = &mut self.record;
        record.written_monotonic_ns = monotonic_ns();
        record.published = count(&counters.published);
        // In this order: the camera's thread counts the other way round, and the second holds the first.
        record.incomplete = count(&counters.incomplete);
        record.lost = count(&counters.lost);
        record.no_free_slot = count(&counters.no_free_slot);
        record.epochs = count(&counters.epochs);
        record.failures = count(&counters.failures);
        record.temperature_c = counters.temperature_c();
        record.resident_bytes = resident_bytes();
        record.cpu_ns = cpu_ns();
        let mask_id = counters.mask_id();
        record.mask_id = mask_id.0;
        record.mask_mode = if mask_id == MaskId::NONE { MaskMode::None } else { self.mask_mode } as u32;
        record.arrival_to_masked = counters.arrival_to_masked.summary();
        record.masked_to_sent = counters.masked_to_sent.summary();
        if let Some(Err(error)) = self.publisher.as_ref().map(|publisher| publisher.publish(&self.record)) {
            tracing::debug!("health: {error}");
        }
    }

    /// Makes the publisher anew where its files were removed, so that readers find it. To be called about once a second.
    pub fn keep_open(&mut self, config: &Config, camera: &CameraConfig) {
        let create = || HealthPublisher::create_at_once(&config.ipc.settings, &camera.name);
        if let Err(error) = Footing::keep(&mut self.publisher, HealthPublisher::footing, create) {
            tracing::debug!("health: {error}");
        }
    }

    /// Gives the record to readers that have come since.
    pub fn serve_newcomers(&self) {
        if let Some(Err(error)) = self.publisher.as_ref().map(HealthPublisher::serve_newcomers) {
            tracing::debug!("health: {error}");
        }
    }
}

/// What an error means to whoever looks at the camera from outside.
fn cause(error: &Error) -> Cause {
    match error {
        Error::Camera(CameraError::Absent { .. } | CameraError::Replaced { .. }) => Cause::Absent,
        Error::Camera(CameraError::Disconnected { .. }) => Cause::Disconnected,
        Error::Camera(CameraError::Silent { .. }) => Cause::Silent,
        Error::Camera(CameraError::Incomplete { .. }) => Cause::Incomplete,
        Error::Camera(CameraError::Refused { .. }) | Error::NotRestored(_) => Cause::Settings,
        Error::Mask(_) | Error::MaskFile(_) | Error::Apply(_) | Error::Image(_) => Cause::Mask,
        Error::Ipc(_) | Error::Loan(_) | Error::Header(_) => Cause::SharedMemory,
        _ => Cause::Device,
    }
}

/// Memory of this process (proc_pid_status(5): `VmRSS`, in kB); 0 where the system does not tell.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.strip_suffix("kB"));
    resident.and_then(|kilobytes| kilobytes.trim().parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Processor time of all threads of this process.
fn cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    seconds.saturating_mul(1_000_000_000).saturating_add(u64::try_from(time.tv_nsec).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_path::tests::Place;

    #[test]
    fn memory_and_processor_time_of_this_process_are_known() {
        let before = cpu_ns();
        let filled = vec![1u8; 32 << 20];
        assert!(resident_bytes() > 32 << 20, "{} bytes are in use", filled.len());
        assert!(cpu_ns() > before);
    }

    #[test]
    fn causes_tell_devices_masks_settings_and_memory_apart() {
        let serial = || String::from("left");
        let disconnected = CameraError::Disconnected { serial: serial(), doing: "streaming" };
        assert_eq!(cause(&disconnected.into()), Cause::Disconnected);
        assert_eq!(cause(&Error::Mask("white".into())), Cause::Mask);
        assert_eq!(cause(&Error::NotRestored("gain".into())), Cause::Settings);
        let place = Place::new();
        let _first = HealthPublisher::create(&place.settings, "left").unwrap();
        let second = HealthPublisher::create_at_once(&place.settings, "left").map(drop).unwrap_err();
        assert_eq!(cause(&second.into()), Cause::SharedMemory);
    }
}
