//! How a camera is.

use std::ffi::c_char;
use std::sync::{Mutex, TryLockError};
use std::time::Duration;

use uvcam_shm_ipc::health::{Cause, Health, HealthReader, Latency, State};

use crate::argument;
use crate::error::{Failure, UVCAM_NONE, UVCAM_OK, call, uvcam_status};
use crate::handle::Table;
use crate::settings::{self, uvcam_settings};

const KIND: &str = "a health reader";

/// A reader of one camera's health. One thread at a time may use it, whichever: a call meanwhile fails with UVCAM_ERROR_BUSY.
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_health_reader(());

/// What a camera's driver does with it. More may come with new versions.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub enum uvcam_state {
    /// It has not been opened yet.
    UVCAM_STATE_STARTING = 1,
    /// Frames are published.
    UVCAM_STATE_STREAMING = 2,
    /// Lit frames are collected for a mask; nothing is published.
    UVCAM_STATE_GENERATING = 3,
    /// It failed or is absent, and is tried again.
    UVCAM_STATE_RECONNECTING = 4,
    /// It stays closed until someone changes its mask or the configuration.
    UVCAM_STATE_REFUSED = 5,
    /// The driver has ended.
    UVCAM_STATE_STOPPED = 6,
}

/// Why a camera does not publish, or last did not. More may come with new versions.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub enum uvcam_cause {
    /// Nothing ever went wrong.
    UVCAM_CAUSE_NONE = 0,
    /// No such device is connected.
    UVCAM_CAUSE_ABSENT = 1,
    /// The device was there and is gone.
    UVCAM_CAUSE_DISCONNECTED = 2,
    /// The device sends nothing.
    UVCAM_CAUSE_SILENT = 3,
    /// Every frame arrives with a part missing.
    UVCAM_CAUSE_INCOMPLETE = 4,
    /// The device or its transport reported an error.
    UVCAM_CAUSE_DEVICE = 5,
    /// A setting reads back as another value.
    UVCAM_CAUSE_SETTINGS = 6,
    /// The mask cannot fly.
    UVCAM_CAUSE_MASK = 7,
    /// Shared memory cannot be used.
    UVCAM_CAUSE_SHARED_MEMORY = 8,
    /// A call into the device's library does not return.
    UVCAM_CAUSE_STUCK = 9,
}

/// How long frames took through one stage, in ns, since the driver started. Quantiles are upper bounds, at most 3.2 % too high.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_latency {
    /// Frames measured.
    pub count: u64,
    /// Half of the frames took no longer.
    pub p50_ns: u64,
    /// 90 % took no longer.
    pub p90_ns: u64,
    /// 99 % took no longer.
    pub p99_ns: u64,
    /// 99.9 % took no longer.
    pub p999_ns: u64,
    /// The longest.
    pub max_ns: u64,
}

/// How a camera is: a record that its driver renews every second, and with every change of state.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_health {
    /// One of uvcam_state.
    pub state: u32,
    /// One of uvcam_cause: what last ended or kept off a stream. It stays when the camera streams again.
    pub cause: u32,
    /// The same two in words, lower case.
    pub state_text: [c_char; 16],
    /// The same two in words, lower case.
    pub cause_text: [c_char; 16],
    /// CLOCK_MONOTONIC in ns when the record was written. Older than three seconds, it speaks of a driver that is gone or stuck.
    pub written_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns since when the state holds.
    pub state_since_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns when the process that runs the camera started.
    pub started_monotonic_ns: u64,
    /// Id of the process that runs the camera.
    pub process_id: u32,
    /// Frames published a second, over the last second.
    pub frame_rate: f64,
    /// Temperature of the device in degrees Celsius; NaN where it tells none.
    pub temperature_c: f64,
    /// Frames sent, since that process started, as all counters.
    pub published: u64,
    /// Frames that the device is known to have produced and no stream published.
    pub lost: u64,
    /// Frames that arrived with a part missing; they are among the lost.
    pub incomplete: u64,
    /// Times that no free slot was there for the camera to fill.
    pub no_free_slot: u64,
    /// Streams begun.
    pub epochs: u64,
    /// Streams, and attempts to open the camera, that ended in an error.
    pub failures: u64,
    /// Memory of that process, shared memory that it touched included, in bytes.
    pub resident_bytes: u64,
    /// Processor time of that process, in ns.
    pub cpu_ns: u64,
    /// Identity of the mask in force; all zero where none is.
    pub mask_id: [u8; 16],
    /// First 16 bytes of the SHA-256 of the configuration's text.
    pub config_digest: [u8; 16],
    /// From the whole frame in memory to its mask applied.
    pub arrival_to_masked: uvcam_latency,
    /// From the mask applied to the frame sent and sleeping consumers woken.
    pub masked_to_sent: uvcam_latency,
    /// Text of the last error, UTF-8; empty where there was none.
    pub last_error: [c_char; 257],
}

macro_rules! assert_same_codes {
    ($($ours:path = $theirs:path),+ $(,)?) => { $(const _: () = assert!($ours as u32 == $theirs as u32);)+ };
}

assert_same_codes! {
    uvcam_state::UVCAM_STATE_STARTING = State::Starting, uvcam_state::UVCAM_STATE_STREAMING = State::Streaming,
    uvcam_state::UVCAM_STATE_GENERATING = State::Generating, uvcam_state::UVCAM_STATE_RECONNECTING = State::Reconnecting,
    uvcam_state::UVCAM_STATE_REFUSED = State::Refused, uvcam_state::UVCAM_STATE_STOPPED = State::Stopped,
    uvcam_cause::UVCAM_CAUSE_NONE = Cause::None, uvcam_cause::UVCAM_CAUSE_ABSENT = Cause::Absent,
    uvcam_cause::UVCAM_CAUSE_DISCONNECTED = Cause::Disconnected, uvcam_cause::UVCAM_CAUSE_SILENT = Cause::Silent,
    uvcam_cause::UVCAM_CAUSE_INCOMPLETE = Cause::Incomplete, uvcam_cause::UVCAM_CAUSE_DEVICE = Cause::Device,
    uvcam_cause::UVCAM_CAUSE_SETTINGS = Cause::Settings, uvcam_cause::UVCAM_CAUSE_MASK = Cause::Mask,
    uvcam_cause::UVCAM_CAUSE_SHARED_MEMORY = Cause::SharedMemory, uvcam_cause::UVCAM_CAUSE_STUCK = Cause::Stuck,
}

static READERS: Table<Mutex<HealthReader>> = Table::new(KIND);

/// Finds the driver of a camera: UVCAM_OK, or UVCAM_NONE where none runs. Arguments as those of uvcam_open(); `reader` becomes NULL where
/// there is none.
///
/// # Safety
/// Law 1 for `camera` and the members of `settings`, law 2 for `settings`, law 3 for `reader`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_health_open(
    camera: *const c_char,
    settings: *const uvcam_settings,
    reader: *mut *mut uvcam_health_reader,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(reader, "a place for a health reader") }?;
        let place = place.write(std::ptr::null_mut());
        // SAFETY: law 1.
        let camera = unsafe { argument::camera(camera) }?;
        // SAFETY: laws 1 and 2.
        let settings = unsafe { settings::read(settings) }?;
        let Some(reader) = HealthReader::open(&settings, camera)? else { return Ok(UVCAM_NONE) };
        *place = READERS.insert(Mutex::new(reader));
        Ok(UVCAM_OK)
    })
}

/// Gives the newest record that has not been read, and waits for it at most `timeout_ms`: UVCAM_OK, or UVCAM_NONE where none came. After
/// three seconds without one, the driver is gone or stuck: close the reader, and open another.
///
/// # Safety
/// Law 3 for `health`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_health_read(
    reader: *mut uvcam_health_reader,
    timeout_ms: u32,
    health: *mut uvcam_health,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(health, "a place for a health record") }?;
        let reader = READERS.get(reader)?;
        let mut reader = reader.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => Failure::busy(KIND),
            TryLockError::Poisoned(_) => Failure::fault("this health reader has failed before: close it"),
        })?;
        let Some(record) = reader.wait(Duration::from_millis(timeout_ms.into()))? else {
            return Ok(UVCAM_NONE);
        };
        place.write(uvcam_health::from(&record));
        Ok(UVCAM_OK)
    })
}

/// Closes a health reader.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_health_close(reader: *mut uvcam_health_reader) -> uvcam_status {
    call(|| READERS.remove(reader).map(|_| UVCAM_OK))
}

impl From<&Health> for uvcam_health {
    fn from(health: &Health) -> Self {
        uvcam_health {
            state: health.state,
            cause: health.cause,
            state_text: chars(health.state().map_or("", State::as_str)),
            cause_text: chars(health.cause().map_or("", Cause::as_str)),
            written_monotonic_ns: health.written_monotonic_ns,
            state_since_monotonic_ns: health.state_since_monotonic_ns,
            started_monotonic_ns: health.started_monotonic_ns,
            process_id: health.process_id,
            frame_rate: health.frame_rate,
            temperature_c: health.temperature_c,
            published: health.published,
            lost: health.lost,
            incomplete: health.incomplete,
            no_free_slot: health.no_free_slot,
            epochs: health.epochs,
            failures: health.failures,
            resident_bytes: health.resident_bytes,
            cpu_ns: health.cpu_ns,
            mask_id: health.mask_id,
            config_digest: health.config_digest,
            arrival_to_masked: latency(&health.arrival_to_masked),
            masked_to_sent: latency(&health.masked_to_sent),
            last_error: chars(&health.last_error()),
        }
    }
}

fn latency(latency: &Latency) -> uvcam_latency {
    let Latency { count, p50_ns, p90_ns, p99_ns, p999_ns, max_ns } = *latency;
    uvcam_latency { count, p50_ns, p90_ns, p99_ns, p999_ns, max_ns }
}

/// A text with a zero behind it, cut at a character where it is too long.
fn chars<const N: usize>(text: &str) -> [c_char; N] {
    let mut chars = [0; N];
    let room = (0..=text.len().min(N - 1)).rev().find(|&end| text.is_char_boundary(end)).unwrap_or(0);
    for (to, from) in chars.iter_mut().zip(text.bytes().take(room)) {
        *to = from as c_char;
    }
    chars
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn read(text: &[c_char]) -> String {
        let bytes: Vec<u8> = text.iter().flat_map(|char| char.to_ne_bytes()).collect();
        CStr::from_bytes_until_nul(&bytes).unwrap().to_str().unwrap().to_owned()
    }

    #[test]
    fn texts_end_with_a_zero_and_with_a_whole_character() {
        let mut health = Health::new();
        health.set_last_error(&"é".repeat(200));
        let told = uvcam_health::from(&health);
        assert_eq!(read(&told.state_text), "starting");
        assert_eq!(read(&told.cause_text), "none");
        assert_eq!(read(&told.last_error), "é".repeat(128));
        let short: [c_char; 4] = chars("aéé");
        assert_eq!(read(&short), "aé");
        let long: [c_char; 4] = chars("ééé");
        assert_eq!(read(&long), "é");
    }
}
