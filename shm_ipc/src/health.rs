//! How a camera is: one record of plain data, kept up to date by its driver.
//!
//! The service `uvcam/v2/<camera>/health` is publish-subscribe of [`Health`] with a history of one: a reader gets the newest record as
//! soon as the driver has seen it, and a new one at least every second and with every change of state. A reader that does not look has
//! only the newest waiting. Nothing here is near the path of a frame.
//!
//! 544 bytes, little-endian; reserved bytes are zero:
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..64 | which record it is, state and cause, since when, rate, temperature |
//! | 64..128 | counters, memory and processor time |
//! | 128..192 | identities of mask and configuration |
//! | 192..288 | latencies, stage by stage |
//! | 288..544 | text of the last error |
//!
//! A reader trusts nothing: it copies the record, checks the copy, and uses that.

use std::mem::{offset_of, size_of};

use iceoryx2::prelude::ZeroCopySend;
use thiserror::Error;

use crate::header::CONTRACT_VERSION;

mod service;

pub use service::{HealthPublisher, HealthReader, health_service_name};

/// "UVCH" in memory: the first four bytes of every record.
pub const HEALTH_MAGIC: u32 = u32::from_le_bytes(*b"UVCH");

/// Bytes that the text of an error can have.
const LONGEST_ERROR: usize = 256;

/// What a camera's driver does with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum State {
    /// It has not been opened yet.
    Starting = 1,
    /// Frames are published.
    Streaming = 2,
    /// Lit frames are collected for a mask; nothing is published.
    Generating = 3,
    /// It failed or is absent, and is tried again.
    Reconnecting = 4,
    /// It stays closed until someone changes its mask or the configuration.
    Refused = 5,
    /// The driver has ended.
    Stopped = 6,
}

/// Why a camera does not publish, or last did not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum Cause {
    /// Nothing ever went wrong.
    None = 0,
    /// No such device is connected.
    Absent = 1,
    /// The device was there and is gone.
    Disconnected = 2,
    /// The device sends nothing.
    Silent = 3,
    /// Every frame arrives with a part missing.
    Incomplete = 4,
    /// The device or its transport reported an error.
    Device = 5,
    /// A setting reads back as another value.
    Settings = 6,
    /// The mask cannot fly.
    Mask = 7,
    /// Shared memory cannot be used.
    SharedMemory = 8,
    /// A call into the device's library does not return.
    Stuck = 9,
}

/// What becomes of the mask in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum MaskMode {
    /// There is none.
    None = 0,
    /// What it masks is black in every frame ([`Flags::MASKED`](crate::Flags::MASKED)).
    Blank = 1,
    /// It travels beside frames that are left as they are ([`Flags::MASK_ATTACHED`](crate::Flags::MASK_ATTACHED)).
    Attach = 2,
}

macro_rules! codes {
    ($type:ident: $($variant:ident = $word:literal),+ $(,)?) => {
        impl $type {
            const ALL: &[$type] = &[$($type::$variant),+];

            /// The word for it, in lower case.
            pub const fn as_str(self) -> &'static str {
                match self { $($type::$variant => $word),+ }
            }

            fn from_code(code: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|one| *one as u32 == code)
            }
        }
    };
}

codes! { State:
    Starting = "starting", Streaming = "streaming", Generating = "generating", Reconnecting = "reconnecting", Refused = "refused",
    Stopped = "stopped",
}
codes! { MaskMode: None = "none", Blank = "blank", Attach = "attach" }
codes! { Cause:
    None = "none", Absent = "absent", Disconnected = "disconnected", Silent = "silent", Incomplete = "incomplete", Device = "device",
    Settings = "settings", Mask = "mask", SharedMemory = "shared memory", Stuck = "stuck",
}

/// How long frames took through one stage, in ns, since the driver started. Quantiles are upper bounds, at most 3.2 % too high.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[repr(C)]
#[type_name("uvcam::Latency")]
pub struct Latency {
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

/// The record. The layout is part of the contract; see the table in this file.
///
/// Any bytes are a valid `Health` in memory; [`Health::validate`] tells whether they make sense.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("uvcam::Health")]
#[non_exhaustive]
pub struct Health {
    /// [`HEALTH_MAGIC`].
    pub magic: u32,
    /// [`CONTRACT_VERSION`].
    pub contract_version: u16,
    /// Bytes of this record.
    pub record_size: u16,
    /// Code of the [`State`].
    pub state: u32,
    /// Code of the [`Cause`] that last ended or kept off a stream. It stays when the camera streams again.
    pub cause: u32,
    /// CLOCK_MONOTONIC in ns when the record was written. Older than three seconds, it speaks of a driver that is gone or stuck.
    pub written_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns since when the state holds.
    pub state_since_monotonic_ns: u64,
    /// CLOCK_MONOTONIC in ns when the process that runs the camera started.
    pub started_monotonic_ns: u64,
    /// Id of the process that runs the camera.
    pub process_id: u32,
    /// Code of the [`MaskMode`] of the mask in force.
    pub mask_mode: u32,
    /// Frames published a second, over the last second.
    pub frame_rate: f64,
    /// Temperature of the device in degrees Celsius; NaN where it tells none.
    pub temperature_c: f64,

    /// Frames sent, since that process started, as all counters.
    pub published: u64,
    /// Frames that the device is known to have produced and no stream published: those that arrived with a part missing, and gaps in the
    /// device's own frame ids. With `published`, all that [`FrameHeader::produced`](crate::FrameHeader::produced) counted since.
    pub lost: u64,
    /// Frames that arrived with a part missing; they are among the lost.
    pub incomplete: u64,
    /// Times that no free slot was there for the camera to fill.
    pub no_free_slot: u64,
    /// Streams begun.
    pub epochs: u64,
    /// Streams, and attempts to open the camera, that ended in an error. Looks for a camera that is absent do not count.
    pub failures: u64,
    /// Memory of the process that runs the camera, shared memory that it touched included, in bytes.
    pub resident_bytes: u64,
    /// Processor time of the process that runs the camera, in ns. It may run others as well.
    pub cpu_ns: u64,

    /// Identity of the mask in force; all zero where none is.
    pub mask_id: [u8; 16],
    /// First 16 bytes of the SHA-256 of the configuration's text.
    pub config_digest: [u8; 16],
    /// Zero.
    pub(crate) reserved_identity: [u64; 4],

    /// From the whole frame in memory to its mask applied.
    pub arrival_to_masked: Latency,
    /// From the mask applied to the frame sent and sleeping consumers woken.
    pub masked_to_sent: Latency,

    /// The last error in UTF-8, cut at a character, filled up with zeros.
    pub last_error: [u8; LONGEST_ERROR],
}

macro_rules! assert_offsets {
    ($($field:ident: $offset:literal),+ $(,)?) => {
        $(const _: () = assert!(offset_of!(Health, $field) == $offset);)+
    };
}

assert_offsets! {
    magic: 0, contract_version: 4, record_size: 6, state: 8, cause: 12, written_monotonic_ns: 16, state_since_monotonic_ns: 24,
    started_monotonic_ns: 32, process_id: 40, mask_mode: 44, frame_rate: 48, temperature_c: 56,
    published: 64, lost: 72, incomplete: 80, no_free_slot: 88, epochs: 96, failures: 104, resident_bytes: 112, cpu_ns: 120,
    mask_id: 128, config_digest: 144, reserved_identity: 160, arrival_to_masked: 192, masked_to_sent: 240, last_error: 288,
}
const _: () = assert!(size_of::<Health>() == 544 && size_of::<Latency>() == 48);

impl Health {
    /// A record of a camera that has not been opened: magic, version and size filled, no temperature, all else zero.
    pub fn new() -> Self {
        Health {
            magic: HEALTH_MAGIC,
            contract_version: CONTRACT_VERSION,
            record_size: size_of::<Health>() as u16,
            state: State::Starting as u32,
            cause: Cause::None as u32,
            written_monotonic_ns: 0,
            state_since_monotonic_ns: 0,
            started_monotonic_ns: 0,
            process_id: 0,
            mask_mode: MaskMode::None as u32,
            frame_rate: 0.0,
            temperature_c: f64::NAN,
            published: 0,
            lost: 0,
            incomplete: 0,
            no_free_slot: 0,
            epochs: 0,
            failures: 0,
            resident_bytes: 0,
            cpu_ns: 0,
            mask_id: [0; 16],
            config_digest: [0; 16],
            reserved_identity: [0; 4],
            arrival_to_masked: Latency::default(),
            masked_to_sent: Latency::default(),
            last_error: [0; LONGEST_ERROR],
        }
    }

    /// The state.
    ///
    /// # Errors
    /// [`HealthError::State`] where the code is not part of the contract.
    pub fn state(&self) -> Result<State, HealthError> {
        State::from_code(self.state).ok_or(HealthError::State(self.state))
    }

    /// The cause.
    ///
    /// # Errors
    /// [`HealthError::Cause`] where the code is not part of the contract.
    pub fn cause(&self) -> Result<Cause, HealthError> {
        Cause::from_code(self.cause).ok_or(HealthError::Cause(self.cause))
    }

    /// What becomes of the mask in force.
    ///
    /// # Errors
    /// [`HealthError::MaskMode`] where the code is not part of the contract.
    pub fn mask_mode(&self) -> Result<MaskMode, HealthError> {
        MaskMode::from_code(self.mask_mode).ok_or(HealthError::MaskMode(self.mask_mode))
    }

    /// Temperature of the device in degrees Celsius, where it tells one.
    pub fn temperature_c(&self) -> Option<f64> {
        self.temperature_c.is_finite().then_some(self.temperature_c)
    }

    /// The text of the last error; empty where there was none. Bytes that are not UTF-8 are replaced.
    pub fn last_error(&self) -> String {
        let end = self.last_error.iter().position(|byte| *byte == 0).unwrap_or(LONGEST_ERROR);
        String::from_utf8_lossy(self.last_error.get(..end).unwrap_or_default()).into_owned()
    }

    /// Keeps the text of an error, or as much of it as there is room for.
    pub fn set_last_error(&mut self, text: &str) {
        let end =
            (0..=text.len().min(LONGEST_ERROR)).rev().find(|&end| text.is_char_boundary(end)).unwrap_or(0);
        self.last_error = [0; LONGEST_ERROR];
        for (kept, byte) in self.last_error.iter_mut().zip(text.bytes().take(end)) {
            *kept = byte;
        }
    }

    /// Checks that the record can be trusted. To be called on a copy: who publishes may write to shared memory at any time.
    ///
    /// # Errors
    /// [`HealthError`] names the first field that is wrong.
    pub fn validate(&self) -> Result<(), HealthError> {
        if self.magic != HEALTH_MAGIC {
            return Err(HealthError::Magic(self.magic));
        }
        if self.contract_version != CONTRACT_VERSION {
            return Err(HealthError::ContractVersion(self.contract_version));
        }
        if usize::from(self.record_size) != size_of::<Health>() {
            return Err(HealthError::RecordSize(self.record_size));
        }
        self.state()?;
        self.cause()?;
        self.mask_mode()?;
        if !(self.frame_rate.is_finite() && self.frame_rate >= 0.0) {
            return Err(HealthError::FrameRate(self.frame_rate));
        }
        for latency in [self.arrival_to_masked, self.masked_to_sent] {
            let Latency { p50_ns, p90_ns, p99_ns, p999_ns, max_ns, .. } = latency;
            if !(p50_ns <= p90_ns && p90_ns <= p99_ns && p99_ns <= p999_ns && p999_ns <= max_ns) {
                return Err(HealthError::Latency(latency));
            }
        }
        Ok(())
    }
}

impl Default for Health {
    fn default() -> Self {
        Health::new()
    }
}

/// Why a record is not to be trusted.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum HealthError {
    /// Not a record of this contract.
    #[error("magic {0:#010x} is not {HEALTH_MAGIC:#010x} (\"UVCH\"): not a health record of uvcam")]
    Magic(u32),
    /// Another version of the contract.
    #[error("contract version {0} is not {CONTRACT_VERSION}: use driver and reader of one version")]
    ContractVersion(u16),
    /// A record of another size.
    #[error("a record of {0} bytes is not one of {size} bytes", size = size_of::<Health>())]
    RecordSize(u16),
    /// A state that is not part of the contract.
    #[error("state {0} is none of 1 to 6")]
    State(u32),
    /// A cause that is not part of the contract.
    #[error("cause {0} is none of 0 to 9")]
    Cause(u32),
    /// A mask mode that is not part of the contract.
    #[error("mask mode {0} is none of 0 to 2")]
    MaskMode(u32),
    /// No rate.
    #[error("{0} is no frame rate")]
    FrameRate(f64),
    /// Quantiles out of order.
    #[error("latencies out of order: {0:?}")]
    Latency(Latency),
}

#[cfg(test)]
mod tests;
