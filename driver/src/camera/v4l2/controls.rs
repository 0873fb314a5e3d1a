//! Exposure and gain fixed, everything that would change them switched off.

use std::io;

use rustix::io::Errno;
use v4l::v4l_sys::*;

use crate::camera::source::V4l2;
use crate::camera::{CameraError, GAIN_TOLERANCE_DB, Grid, Settings, exposure_tolerance_us, verify};
use crate::told::OPENING;

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
    /// The value nearest to nothing.
    fn next_to_zero(self) -> i64 {
        // Not `clamp`, which does not take bounds that make no sense.
        0.max(self.minimum).min(self.maximum)
    }

    fn contains(self, value: i64) -> bool {
        (self.minimum..=self.maximum).contains(&value)
    }
}

/// What would change a picture by itself, its name, and the value that makes it stop. A device has few of them. The mains
/// frequency makes automatic exposures avoid flicker; white balance and hue reach the luma of YUYV.
const AUTOMATICS: [(u32, &str, i64); 6] = [
    (V4L2_CID_EXPOSURE_AUTO, "exposure_auto", v4l2_exposure_auto_type_V4L2_EXPOSURE_MANUAL as i64),
    (V4L2_CID_AUTOGAIN, "gain_automatic", 0),
    (V4L2_CID_AUTOBRIGHTNESS, "brightness_automatic", 0),
    (V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", 0),
    (V4L2_CID_HUE_AUTO, "hue_automatic", 0),
    (V4L2_CID_WIDE_DYNAMIC_RANGE, "wide_dynamic_range", 0),
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
    // Lets an automatic exposure lower the frame rate. Off before that is: a device may lock it while the exposure is fixed (USB Video
    // Class 1.1, 4.2.2.1.3), and it changes nothing then.
    leave_where_locked(set_where_present(
        controls,
        V4L2_CID_EXPOSURE_AUTO_PRIORITY,
        "exposure_dynamic_framerate",
        0,
    ))?;
    for (id, name, off) in AUTOMATICS {
        set_where_present(controls, id, name, off)?;
    }
    // No automatic but a constant, which need not know 0.
    let id = V4L2_CID_BACKLIGHT_COMPENSATION;
    if let Some(range) = controls.range(id)? {
        leave_where_locked(set(controls, id, "backlight_compensation", range.next_to_zero()))?;
    }
    let id = V4L2_CID_POWER_LINE_FREQUENCY;
    let disabled = v4l2_power_line_frequency_V4L2_CID_POWER_LINE_FREQUENCY_DISABLED.into();
    // Some cameras know 50 Hz and 60 Hz only. With a fixed exposure it changes nothing.
    if controls.range(id)?.is_some_and(|range| range.contains(disabled)) {
        set(controls, id, "power_line_frequency", disabled)?;
    }
    Ok(())
}

/// For what changes no picture of a fixed exposure by itself: a refusal is a warning.
fn leave_where_locked(outcome: Result<(), Failure>) -> Result<(), Failure> {
    match outcome {
        Err(Failure::Refused(error)) => {
            tracing::warn!(target: OPENING, "{error}; left as it is: the exposure is fixed");
            Ok(())
        }
        outcome => outcome,
    }
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
    if controls.range(id)?.is_none() {
        return fixed_exposure(settings, source);
    }
    let applied = controls.read(id)? as f64 * EXPOSURE_UNIT_US;
    verify("exposure_us", settings.exposure_us, applied, exposure_tolerance_us(settings.exposure_us))?;
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
    let Range { minimum, maximum, step } = range;
    let [minimum_us, maximum_us, step_us] =
        [minimum, maximum, step].map(|units| units as f64 * EXPOSURE_UNIT_US);
    let tolerance_us = exposure_tolerance_us(exposure_us);
    let nearest_us =
        Grid::new(minimum_us, maximum_us, step_us).check("exposure_us", exposure_us, tolerance_us)?;
    Ok((nearest_us / EXPOSURE_UNIT_US).round() as i64)
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
    let steps = controls.read(id)?.saturating_sub(range.minimum) as f64;
    // Without a scale the lowest gain alone is known.
    let applied = if steps == 0.0 { 0.0 } else { steps * source.gain_step_db.unwrap_or(f64::NAN) };
    verify("gain_db", settings.gain_db, applied, GAIN_TOLERANCE_DB)?;
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
    let Range { minimum, maximum, step } = range;
    let largest_db = maximum.saturating_sub(minimum) as f64 * step_db;
    let nearest_db =
        Grid::new(0.0, largest_db, step as f64 * step_db).check("gain_db", gain_db, GAIN_TOLERANCE_DB)?;
    Ok(minimum.saturating_add((nearest_db / step_db).round() as i64))
}

/// Sets a control, where the device has it, and reads it back.
fn set_where_present(
    controls: &dyn Controls,
    id: u32,
    name: &'static str,
    value: i64,
) -> Result<(), Failure> {
    match controls.range(id)? {
        Some(_) => set(controls, id, name, value),
        None => Ok(()),
    }
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

/// Whether the device answers that it does not take a value: there is no such one, the control is read-only, locked in the present state,
/// or it is held. A USB device that refuses a request without a word stalls its pipe.
fn is_no(error: &io::Error) -> bool {
    matches!(
        Errno::from_io_error(error),
        Some(Errno::INVAL | Errno::RANGE | Errno::ACCESS | Errno::BUSY | Errno::ILSEQ | Errno::PIPE)
    )
}

#[cfg(test)]
mod tests;
