//! From whatever state the device is in to the one that the configuration asks for.
//!
//! The order matters: the user set first, since it overwrites all else; the format before the region, the region before rates
//! (both bound what follows); exposure before the frame rate, which it bounds; and everything is read back at the end, when
//! nothing can change it any more.

use aravis::RangeCheckPolicy;
use aravis::prelude::*;
use uvcam_shm_ipc::PixelFormat;

use super::features::{Features, Number};
use crate::camera::{
    Applied, CameraError, GAIN_TOLERANCE_DB, Settings, exposure_tolerance_us, frame_rate_tolerance,
};

/// What the device would otherwise adjust while flying. A device has few of them.
const AUTOMATICS: [&str; 5] =
    ["ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto", "pgrExposureCompensationAuto"];

/// The rate that the device reaches with all settings taken together, where it tells: Basler ace (USB3, GigE) and ace 2,
/// FLIR, Matrix Vision.
const RESULTING_FRAME_RATES: [&str; 5] = [
    "ResultingFrameRate",
    "ResultingFrameRateAbs",
    "BslResultingAcquisitionFrameRate",
    "AcquisitionResultingFrameRate",
    "mvResultingFrameRate",
];

/// How far an exposure may lie beside a grid that the device tells, microseconds. What it reads back tells nothing then: it must be met.
const BESIDE_GRID_US: f64 = 1.0;

/// Applies all settings and reads them back.
pub(super) fn configure(features: &Features, settings: &Settings) -> Result<Applied, CameraError> {
    settings.check_exposure_fits(0.0)?;
    features.camera.set_range_check_policy(RangeCheckPolicy::Enable);
    // A program that was killed leaves the device running, its format locked. A device that stands still may refuse to stop.
    let _ = features.camera.stop_acquisition();
    load_default_user_set(features)?;
    features.switch_where_present("ChunkModeActive", false)?;
    features.choose_where_present("AcquisitionMode", "Continuous")?;
    triggers_off(features)?;
    features.choose_where_present("ExposureMode", "Timed")?;
    for name in AUTOMATICS {
        features.choose_where_present(name, "Off")?;
    }

    features.choose("pixel_format", "PixelFormat", settings.pixel_format.name())?;
    let region = Region::of(features)?;
    region.write(settings)?;
    let gain = Gain::of(features, settings)?;
    gain.write(settings)?;
    let (exposure, frame_rate) = write_rates(features, settings)?;

    features.choose("pixel_format", "PixelFormat", settings.pixel_format.name())?;
    region.verify(settings)?;
    let applied = Applied {
        width: settings.width,
        height: settings.height,
        stride: stride(settings),
        pixel_format: settings.pixel_format,
        fps: frame_rate.verify(settings.fps)?,
        exposure_us: exposure.verify(settings.exposure_us)?,
        gain_db: gain.verify(settings)?,
        payload_bytes: payload_bytes(features, settings)?,
    };
    Ok(applied)
}

fn stride(settings: &Settings) -> u32 {
    settings.width * PixelFormat::bytes_per_pixel(settings.pixel_format) as u32
}

/// A device keeps its settings; the factory's user set undoes what another program left behind.
fn load_default_user_set(features: &Features) -> Result<(), CameraError> {
    if features.entries("UserSetSelector")?.iter().any(|entry| entry == "Default")
        && features.has("UserSetLoad")?
    {
        features.choose("UserSetSelector", "UserSetSelector", "Default")?;
        features.camera.execute_command("UserSetLoad").map_err(|error| features.failed(error))?;
    }
    Ok(())
}

fn triggers_off(features: &Features) -> Result<(), CameraError> {
    let triggers = features.entries("TriggerSelector")?;
    if triggers.is_empty() {
        return features.choose_where_present("TriggerMode", "Off");
    }
    for trigger in triggers {
        features.choose("TriggerSelector", "TriggerSelector", &trigger)?;
        features.choose_where_present("TriggerMode", "Off")?;
    }
    Ok(())
}

/// Width, height and place of the image on the sensor.
struct Region<'a> {
    /// A device without them does not bin. With them, every other size is in binned pixels.
    binning_horizontal: Option<Number<'a>>,
    binning_vertical: Option<Number<'a>>,
    width: Number<'a>,
    height: Number<'a>,
    /// A device without them reads the whole sensor.
    offset_x: Option<Number<'a>>,
    offset_y: Option<Number<'a>>,
}

impl<'a> Region<'a> {
    fn of(features: &'a Features) -> Result<Self, CameraError> {
        let required = |setting, name| {
            features.number(setting, &[name], 1.0)?.ok_or_else(|| missing(setting, "any value", name))
        };
        Ok(Region {
            binning_horizontal: features.number("binning_horizontal", &["BinningHorizontal"], 1.0)?,
            binning_vertical: features.number("binning_vertical", &["BinningVertical"], 1.0)?,
            width: required("width", "Width")?,
            height: required("height", "Height")?,
            offset_x: features.number("offset_x", &["OffsetX"], 1.0)?,
            offset_y: features.number("offset_y", &["OffsetY"], 1.0)?,
        })
    }

    fn write(&self, settings: &Settings) -> Result<(), CameraError> {
        for (number, setting, asked) in self.binning(settings) {
            match number {
                // Many devices lock it where it has one value only.
                Some(number) if number.read()? == f64::from(asked) => {}
                Some(number) => number.write_exactly(asked)?,
                None if asked == 1 => {}
                None => {
                    return Err(missing(
                        setting,
                        &asked.to_string(),
                        "BinningHorizontal and BinningVertical",
                    ));
                }
            }
        }
        let offsets = [
            (&self.offset_x, "offset_x", settings.offset_x),
            (&self.offset_y, "offset_y", settings.offset_y),
        ];
        // An offset bounds the size: out of the way first.
        for number in offsets.iter().filter_map(|(number, ..)| number.as_ref()) {
            number.write(number.bounds()?.0)?;
        }
        self.width.write_exactly(settings.width)?;
        self.height.write_exactly(settings.height)?;
        for (number, setting, asked) in offsets {
            match number {
                Some(number) => number.write_exactly(asked)?,
                None if asked == 0 => {}
                None => return Err(missing(setting, &asked.to_string(), "OffsetX and OffsetY")),
            }
        }
        Ok(())
    }

    fn binning(&self, settings: &Settings) -> [(&Option<Number<'a>>, &'static str, u32); 2] {
        [
            (&self.binning_horizontal, "binning_horizontal", settings.binning_horizontal),
            (&self.binning_vertical, "binning_vertical", settings.binning_vertical),
        ]
    }

    fn verify(&self, settings: &Settings) -> Result<(), CameraError> {
        for (number, _, asked) in self.binning(settings) {
            if let Some(number) = number {
                number.verify_exactly(asked)?;
            }
        }
        self.width.verify_exactly(settings.width)?;
        self.height.verify_exactly(settings.height)?;
        for (number, asked) in [(&self.offset_x, settings.offset_x), (&self.offset_y, settings.offset_y)] {
            if let Some(number) = number {
                number.verify_exactly(asked)?;
            }
        }
        Ok(())
    }
}

/// How the device has its gain.
enum Gain<'a> {
    Decibels(Number<'a>),
    /// In steps of its own, of which only the lowest is known to be 0 dB.
    Raw(Number<'a>),
    None,
}

impl<'a> Gain<'a> {
    fn of(features: &'a Features, settings: &Settings) -> Result<Self, CameraError> {
        let selectors = features.entries("GainSelector")?;
        if let Some(all) =
            ["All", "AnalogAll"].into_iter().find(|all| selectors.iter().any(|entry| entry == all))
        {
            features.choose("GainSelector", "GainSelector", all)?;
            features.choose_where_present("GainAuto", "Off")?;
        }
        if let Some(number) = features.number("gain_db", &["Gain", "GainAbs"], GAIN_TOLERANCE_DB)? {
            // Most devices leave the unit out; the SFNC leaves it to the device, and dB is what they mean.
            return match number.unit() {
                Some(unit) if !unit.eq_ignore_ascii_case("dB") => Err(CameraError::Refused {
                    setting: "gain_db",
                    asked: settings.gain_db.to_string(),
                    applied: format!("gain in {unit}"),
                    remedy: "this driver sets gain in decibels only".into(),
                }),
                _ => Ok(Gain::Decibels(number)),
            };
        }
        match features.number("gain_db", &["GainRaw"], GAIN_TOLERANCE_DB)? {
            Some(number) if number.unit().is_some_and(|unit| unit.eq_ignore_ascii_case("dB")) => {
                Ok(Gain::Decibels(number))
            }
            Some(number) => Ok(Gain::Raw(number)),
            None => Ok(Gain::None),
        }
    }

    fn write(&self, settings: &Settings) -> Result<(), CameraError> {
        let only_zero = |applied: String| {
            Err(CameraError::Refused {
                setting: "gain_db",
                asked: settings.gain_db.to_string(),
                applied,
                remedy: "set gain_db = 0".into(),
            })
        };
        match self {
            Gain::Decibels(number) => {
                number.check_on_grid(settings.gain_db, GAIN_TOLERANCE_DB)?;
                number.write(settings.gain_db)
            }
            Gain::Raw(number) if settings.gain_db == 0.0 => number.write(number.bounds()?.0),
            Gain::Raw(number) => {
                only_zero(format!("{} in steps whose decibels it does not tell", number.name))
            }
            Gain::None if settings.gain_db == 0.0 => Ok(()),
            Gain::None => only_zero("no control of gain".into()),
        }
    }

    fn verify(&self, settings: &Settings) -> Result<f64, CameraError> {
        match self {
            Gain::Decibels(number) => number.verify(settings.gain_db),
            Gain::Raw(number) => number.verify(number.bounds()?.0).map(|_| 0.0),
            Gain::None => Ok(0.0),
        }
    }
}

/// Sets exposure and frame rate, and refuses an exposure that the device can only reach at a lower rate.
fn write_rates<'a>(
    features: &'a Features,
    settings: &Settings,
) -> Result<(Number<'a>, Number<'a>), CameraError> {
    let tolerance_us = exposure_tolerance_us(settings.exposure_us);
    let exposure = features
        .number("exposure_us", &["ExposureTime", "ExposureTimeAbs"], tolerance_us)?
        .ok_or_else(|| missing("exposure_us", &settings.exposure_us.to_string(), "ExposureTime"))?;
    // Before the frame rate is enabled: some devices bound the exposure by the rate.
    exposure.check_on_grid(settings.exposure_us, BESIDE_GRID_US)?;
    exposure.write(settings.exposure_us)?;

    // The device sends as fast as the link takes; otherwise a Matrix Vision device collects frames and delays them.
    features.choose_where_present("mvAcquisitionFrameRateLimitMode", "mvDeviceLinkThroughput")?;
    features.choose_where_present("mvAcquisitionFrameRateEnable", "On")?;
    features.switch_where_present("AcquisitionFrameRateEnable", true)?;
    // Older FLIR
    features.switch_where_present("AcquisitionFrameRateEnabled", true)?;
    features.choose_where_present("AcquisitionFrameRateAuto", "Off")?;
    let tolerance = frame_rate_tolerance(settings.fps);
    let frame_rate = features
        .number("fps", &["AcquisitionFrameRate", "AcquisitionFrameRateAbs"], tolerance)?
        .ok_or_else(|| missing("fps", &settings.fps.to_string(), "AcquisitionFrameRate"))?;

    let reach = write_rate_within_reach(features, &frame_rate, settings.fps)?;
    if reach < settings.fps - tolerance {
        return Err(too_slow(features, settings, &exposure, &frame_rate, reach)?);
    }
    frame_rate.check_on_grid(settings.fps, tolerance)?;
    Ok((exposure, frame_rate))
}

/// Asks for a rate, as far as the device lets itself be asked, and returns the rate that it then tells. It is written first: what
/// the device tells includes the rate that it was asked for before.
fn write_rate_within_reach(features: &Features, frame_rate: &Number, fps: f64) -> Result<f64, CameraError> {
    frame_rate.write(fps.min(frame_rate.bounds()?.1))?;
    let (_, bound) = frame_rate.bounds()?;
    match features.number("fps", &RESULTING_FRAME_RATES, 0.0)? {
        Some(resulting) => Ok(resulting.read()?.min(bound)),
        None => Ok(bound),
    }
}

/// Why a rate is out of reach: tries the exposure that would make up for the missing time.
fn too_slow(
    features: &Features,
    settings: &Settings,
    exposure: &Number,
    frame_rate: &Number,
    reach: f64,
) -> Result<CameraError, CameraError> {
    let fits_us = exposure.at_most((settings.exposure_us - (1e6 / reach - 1e6 / settings.fps)).floor())?;
    let fits = fits_us >= exposure.bounds()?.0 && {
        exposure.write(fits_us)?;
        write_rate_within_reach(features, frame_rate, settings.fps)?
            >= settings.fps - frame_rate_tolerance(settings.fps)
    };
    Ok(match fits {
        true => CameraError::Refused {
            setting: "exposure_us",
            asked: settings.exposure_us.to_string(),
            applied: format!("at most {reach:.2} fps with it"),
            remedy: format!("the largest exposure_us that fits at {} fps is {fits_us}", settings.fps),
        },
        false => CameraError::Refused {
            setting: "fps",
            asked: settings.fps.to_string(),
            applied: format!("at most {reach:.2} fps"),
            remedy: "lower fps: a shorter exposure does not help, readout or link of this format and region need the time"
                .into(),
        },
    })
}

/// A frame must fill its slot exactly: a trailer or padding would go where pixels belong.
fn payload_bytes(features: &Features, settings: &Settings) -> Result<usize, CameraError> {
    let payload = features.camera.payload().map_err(|error| features.failed(error))? as usize;
    let expected = stride(settings) as usize * settings.height as usize;
    match payload == expected {
        true => Ok(payload),
        false => Err(CameraError::Refused {
            setting: "pixel_format",
            asked: format!("{}, {expected} bytes a frame", settings.pixel_format.name()),
            applied: format!("PayloadSize {payload}"),
            remedy: "the camera adds padding or other data to its frames; choose another width or format"
                .into(),
        }),
    }
}

fn missing(setting: &'static str, asked: &str, feature: &str) -> CameraError {
    CameraError::Refused {
        setting,
        asked: asked.to_owned(),
        applied: format!("no control of it: the feature {feature} is missing"),
        remedy: "this camera cannot be used".into(),
    }
}
