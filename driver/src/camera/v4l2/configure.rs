//! From whatever state the device is in to the one that the configuration asks for.
//!
//! The order matters: the format before the frame rate, whose choice depends on it; automatics off before what they would change;
//! and exposure and gain are read back at the end, when nothing can change them any more.

use v4l::fraction::Fraction;

use super::controls::{self, Failure};
use super::device::Device;
use super::format::{self, Layout};
use crate::camera::source::{V4l2, V4l2Memory};
use crate::camera::{Applied, CameraError, Settings, frame_rate_tolerance, verify};

/// A time per frame is asked for as this many parts of a second by as many times the rate.
const INTERVAL_UNITS: f64 = 10_000.0;

/// Applies all settings and reads them back.
pub(super) fn configure(
    device: &Device,
    settings: &Settings,
    source: &V4l2,
) -> Result<(Applied, Layout), Failure> {
    settings.check_not_binned()?;
    check_whole_sensor(settings)?;
    settings.check_exposure_fits(0.0)?;
    let fourcc = format::choose(settings.pixel_format, &device.formats())?;
    let given = device.set_format(fourcc, settings.width, settings.height)?;
    let layout = Layout::of(&given, fourcc, settings)?;
    if source.memory == Some(V4l2Memory::UserPointer) && !layout.is_slot() {
        return Err(CameraError::Refused {
            setting: "memory",
            asked: "userptr".into(),
            applied: format!("{fourcc}, whose frames must be copied to lose their padding or colour"),
            remedy: "leave memory out of the source, or set it to \"mmap\"".into(),
        }
        .into());
    }
    let fps = set_rate(device, settings)?;
    controls::automatics_off(device)?;
    controls::write_exposure(device, settings, source)?;
    controls::write_gain(device, settings, source)?;
    let applied = Applied {
        width: settings.width,
        height: settings.height,
        stride: layout.row_bytes() as u32,
        pixel_format: settings.pixel_format,
        fps,
        exposure_us: controls::read_exposure(device, settings, source)?,
        gain_db: controls::read_gain(device, settings, source)?,
        payload_bytes: layout.payload_bytes(),
    };
    Ok((applied, layout))
}

/// V4L2 scales or crops as the driver likes; what a driver delivers at a size is its whole view.
fn check_whole_sensor(settings: &Settings) -> Result<(), CameraError> {
    verify("offset_x", f64::from(settings.offset_x), 0.0, 0.0)?;
    verify("offset_y", f64::from(settings.offset_y), 0.0, 0.0)
}

fn set_rate(device: &Device, settings: &Settings) -> Result<f64, Failure> {
    let Some(applied) = device.set_interval(interval(settings.fps))? else {
        return Err(CameraError::Refused {
            setting: "fps",
            asked: settings.fps.to_string(),
            applied: "no control of it (V4L2_CAP_TIMEPERFRAME)".into(),
            remedy: "this camera cannot be used".into(),
        }
        .into());
    };
    let fps = rate(applied);
    verify("fps", settings.fps, fps, frame_rate_tolerance(settings.fps))?;
    Ok(fps)
}

/// The time per frame to ask for.
fn interval(fps: f64) -> Fraction {
    Fraction::new(INTERVAL_UNITS as u32, (fps * INTERVAL_UNITS).round() as u32)
}

/// The rate that a time per frame stands for, frames a second.
fn rate(interval: Fraction) -> f64 {
    f64::from(interval.denominator) / f64::from(interval.numerator)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_becomes_a_time_per_frame_and_back() {
        for fps in [0.1, 1.0, 29.97, 59.9, 60.0, 10_000.0] {
            assert!((rate(interval(fps)) - fps).abs() < 1e-4 * fps, "{fps}");
        }
        assert_eq!(
            rate(Fraction::new(166_667, 10_000_000)).round(),
            60.0,
            "in units of 100 ns, as UVC counts"
        );
    }

    #[test]
    fn a_sensor_whose_driver_knows_no_rate_is_refused_by_name() {
        // Like such a driver, it answers the question for a rate with ENOTTY.
        let device = Device::open(std::path::Path::new("/dev/null")).unwrap();
        match set_rate(&device, &Settings::new(8, 4, 60.0, 1000.0)) {
            Err(Failure::Refused(error)) => {
                assert!(
                    error.to_string().contains("fps = 60 refused: the camera gives no control of it"),
                    "{error}"
                );
            }
            Err(Failure::Io(error)) => panic!("{error}"),
            Ok(fps) => panic!("{fps} fps"),
        }
    }

    #[test]
    fn a_time_per_frame_of_nothing_passes_for_no_rate() {
        for interval in [Fraction::new(0, 0), Fraction::new(0, 1), Fraction::new(1, 0)] {
            assert!(verify("fps", 60.0, rate(interval), 0.3).is_err(), "{interval}");
        }
    }
}
