//! Exposure and gain fixed, everything that would change them switched off.

use std::io;

use rustix::io::Errno;
use v4l::v4l_sys::*;

use crate::camera::{CameraError, Settings, verify};
use crate::config::V4l2;

/// A device's controls, by their ids (V4L2_CID_*).
pub(super) trait Controls {
    /// The values that a control takes; `None` where the device does not have it.
    fn range(&self, id: u32) -> io::Result<Option<Range>>;
    fn read(&self, id: u32) -> io::Result<i64>;
    fn write(&self, id: u32, value: i64) -> io::Result<()>;
}

/// The values that a control takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Range {
    pub(super) minimum: i64,
    pub(super) maximum: i64,
    pub(super) step: i64,
}

impl Range {
    fn contains(self, value: i64) -> bool {
        (self.minimum..=self.maximum).contains(&value)
    }
}

/// What would change a picture by itself, its name, and the value that makes it stop. A device has few of them. The mains
/// frequency makes automatic exposures avoid flicker; white balance and hue reach the luma of YUYV.
const AUTOMATICS: [(u32, &str, i64); 8] = [
    (V4L2_CID_EXPOSURE_AUTO, "exposure_auto", v4l2_exposure_auto_type_V4L2_EXPOSURE_MANUAL as i64),
    // Lets the device lower its frame rate for a longer exposure.
    (V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure_dynamic_framerate", 0),
    (V4L2_CID_AUTOGAIN, "gain_automatic", 0),
    (V4L2_CID_AUTOBRIGHTNESS, "brightness_automatic", 0),
    (V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", 0),
    (V4L2_CID_HUE_AUTO, "hue_automatic", 0),
    (V4L2_CID_WIDE_DYNAMIC_RANGE, "wide_dynamic_range", 0),
    (V4L2_CID_BACKLIGHT_COMPENSATION, "backlight_compensation", 0),
];

/// V4L2_CID_EXPOSURE_ABSOLUTE counts in this unit.
const EXPOSURE_UNIT_US: f64 = 100.0;
/// V4L2 tells no unit of gain. A sensor behind a bridge has the second one.
const GAINS: [u32; 2] = [V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN];
/// What of a request failed.
pub(super) enum Failure {
    /// The device does not do what it is asked.
    Refused(CameraError),
    /// The device did not answer.
    Io(io::Error),
}

impl From<CameraError> for Failure {
    fn from(error: CameraError) -> Self {
        Failure::Refused(error)
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Failure::Io(error)
    }
}

/// Switches all automatics off.
pub(super) fn automatics_off(controls: &dyn Controls) -> Result<(), Failure> {
    for (id, name, off) in AUTOMATICS {
        if controls.range(id)?.is_some() {
            set(controls, id, name, off)?;
        }
    }
    let id = V4L2_CID_POWER_LINE_FREQUENCY;
    let disabled = v4l2_power_line_frequency_V4L2_CID_POWER_LINE_FREQUENCY_DISABLED.into();
    // Some cameras know 50 Hz and 60 Hz only. With a fixed exposure it changes nothing.
    if controls.range(id)?.is_some_and(|range| range.contains(disabled)) {
        set(controls, id, "power_line_frequency", disabled)?;
    }
    Ok(())
}

/// Sets the exposure time.
pub(super) fn write_exposure(
    controls: &dyn Controls,
    settings: &Settings,
    source: &V4l2,
) -> Result<(), Failure> {
    let id = V4L2_CID_EXPOSURE_ABSOLUTE;
    match controls.range(id)? {
        Some(range) => {
            set(controls, id, "exposure_time_absolute", exposure_value(settings.exposure_us, range)?)
        }
        None => fixed_exposure(settings, source).map(|_| ()),
    }
}

/// The exposure time that the device keeps, microseconds, where it is the one asked for.
pub(super) fn read_exposure(
    controls: &dyn Controls,
    settings: &Settings,
    source: &V4l2,
) -> Result<f64, Failure> {
    let id = V4L2_CID_EXPOSURE_ABSOLUTE;
    let Some(range) = controls.range(id)? else { return fixed_exposure(settings, source) };
    let applied = controls.read(id)? as f64 * EXPOSURE_UNIT_US;
    // Half a step: the nearest one was asked for.
    verify("exposure_us", settings.exposure_us, applied, range.step as f64 * EXPOSURE_UNIT_US / 2.0)?;
    Ok(applied)
}

/// The exposure time of a device that has no control of it, where it is the one asked for.
fn fixed_exposure(settings: &Settings, source: &V4l2) -> Result<f64, Failure> {
    let Some(fixed_us) = source.fixed_exposure_us else {
        return Err(CameraError::Refused {
            setting: "exposure_us",
            asked: settings.exposure_us.to_string(),
            applied: "no control of it (V4L2_CID_EXPOSURE_ABSOLUTE)".into(),
            remedy: "use another camera; or, where its exposure time is known, write it as fixed_exposure_us into its source"
                .into(),
        }
        .into());
    };
    verify("exposure_us", settings.exposure_us, fixed_us, 0.0)?;
    Ok(fixed_us)
}

fn exposure_value(exposure_us: f64, range: Range) -> Result<i64, CameraError> {
    let value = nearest(exposure_us / EXPOSURE_UNIT_US, range);
    let applied = value as f64 * EXPOSURE_UNIT_US;
    let step = range.step as f64 * EXPOSURE_UNIT_US;
    match (exposure_us - applied).abs() <= step / 2.0 {
        true => Ok(value),
        false => Err(CameraError::Refused {
            setting: "exposure_us",
            asked: exposure_us.to_string(),
            applied: format!(
                "{} to {} in steps of {step}",
                range.minimum as f64 * EXPOSURE_UNIT_US,
                range.maximum as f64 * EXPOSURE_UNIT_US
            ),
            remedy: format!("the nearest exposure_us is {applied}"),
        }),
    }
}

/// Sets the gain.
pub(super) fn write_gain(controls: &dyn Controls, settings: &Settings, source: &V4l2) -> Result<(), Failure> {
    let gain = gain_of(controls)?;
    if gain.is_none() && settings.gain_db != 0.0 {
        return Err(CameraError::Refused {
            setting: "gain_db",
            asked: settings.gain_db.to_string(),
            applied: "no control of it".into(),
            remedy: "set gain_db = 0".into(),
        }
        .into());
    }
    if let Some((id, range)) = gain {
        set(controls, id, "gain", gain_value(settings.gain_db, source.gain_step_db, range)?)?;
    }
    Ok(())
}

/// The gain that the device keeps, decibels above its lowest, where it is the one asked for.
pub(super) fn read_gain(controls: &dyn Controls, settings: &Settings, source: &V4l2) -> Result<f64, Failure> {
    let Some((id, range)) = gain_of(controls)? else { return Ok(0.0) };
    let steps = (controls.read(id)? - range.minimum) as f64;
    // Without a scale the lowest gain alone is known.
    let applied = if steps == 0.0 { 0.0 } else { steps * source.gain_step_db.unwrap_or(f64::NAN) };
    let step = source.gain_step_db.unwrap_or(0.0) * range.step as f64 / 2.0;
    verify("gain_db", settings.gain_db, applied, step)?;
    Ok(applied)
}

fn gain_of(controls: &dyn Controls) -> io::Result<Option<(u32, Range)>> {
    for id in GAINS {
        if let Some(range) = controls.range(id)? {
            return Ok(Some((id, range)));
        }
    }
    Ok(None)
}

/// The lowest value is 0 dB; `step_db` tells how many decibels each one above it adds.
fn gain_value(gain_db: f64, step_db: Option<f64>, range: Range) -> Result<i64, CameraError> {
    let Some(step_db) = step_db else {
        return match gain_db == 0.0 {
            true => Ok(range.minimum),
            false => Err(CameraError::Refused {
                setting: "gain_db",
                asked: gain_db.to_string(),
                applied: format!(
                    "{} to {} in a unit that it does not tell",
                    range.minimum, range.maximum
                ),
                remedy: "set gain_db = 0, its lowest gain; or gain_step_db in its source, from the sensor's data sheet"
                    .into(),
            }),
        };
    };
    let value = nearest(range.minimum as f64 + gain_db / step_db, range);
    let applied = (value - range.minimum) as f64 * step_db;
    match (gain_db - applied).abs() <= step_db * range.step as f64 / 2.0 {
        true => Ok(value),
        false => Err(CameraError::Refused {
            setting: "gain_db",
            asked: gain_db.to_string(),
            applied: format!("0 to {}", (range.maximum - range.minimum) as f64 * step_db),
            remedy: format!("the nearest gain_db is {applied}"),
        }),
    }
}

/// The value of the range next to `wanted`.
fn nearest(wanted: f64, range: Range) -> i64 {
    let step = range.step as f64;
    let steps = ((wanted - range.minimum as f64) / step).round();
    let last = ((range.maximum - range.minimum) / range.step) as f64;
    range.minimum + steps.clamp(0.0, last) as i64 * range.step
}

/// Sets a control and reads it back. `name` is what the kernel calls it.
fn set(controls: &dyn Controls, id: u32, name: &'static str, value: i64) -> Result<(), Failure> {
    let refused = |applied: String| CameraError::Refused {
        setting: name,
        asked: value.to_string(),
        applied,
        remedy: "the camera does not let it be changed; another program may hold it".into(),
    };
    if controls.read(id)? == value {
        return Ok(());
    }
    match controls.write(id, value) {
        Err(error) if is_no(&error) => return Err(refused(error.to_string()).into()),
        outcome => outcome?,
    }
    match controls.read(id)? {
        applied if applied == value => Ok(()),
        applied => Err(refused(applied.to_string()).into()),
    }
}

/// Whether the device answers that it does not take a value: there is no such one, the control is read-only, or it is held.
fn is_no(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::INVAL | Errno::RANGE | Errno::ACCESS | Errno::BUSY))
}

#[cfg(test)]
mod tests;
