//! What a camera is asked for, what it applied, and when the two agree.

use uvcam_shm_ipc::PixelFormat;

use super::CameraError;

/// What the configuration asks of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns of the image (SFNC `Width`).
    pub width: u32,
    /// Rows of the image (SFNC `Height`).
    pub height: u32,
    /// Left edge of the region on the sensor, px (SFNC `OffsetX`).
    pub offset_x: u32,
    /// Upper edge of the region on the sensor, px (SFNC `OffsetY`).
    pub offset_y: u32,
    /// Sensor columns that make one column of the image (SFNC `BinningHorizontal`); 1 does not bin.
    pub binning_horizontal: u32,
    /// Sensor rows that make one row of the image (SFNC `BinningVertical`); 1 does not bin.
    pub binning_vertical: u32,
    /// Pixel format by its PFNC name.
    pub pixel_format: PixelFormat,
    /// Frames a second (SFNC `AcquisitionFrameRate`).
    pub fps: f64,
    /// Exposure time in microseconds (SFNC `ExposureTime`).
    pub exposure_us: f64,
    /// Gain in decibels (SFNC `Gain`).
    pub gain_db: f64,
}

/// What a camera applied, as it read back.
#[derive(Debug, Clone, PartialEq)]
pub struct Applied {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Bytes from one row to the next.
    pub stride: u32,
    /// Pixel format.
    pub pixel_format: PixelFormat,
    /// Frames a second.
    pub fps: f64,
    /// Exposure time in microseconds.
    pub exposure_us: f64,
    /// Gain in decibels.
    pub gain_db: f64,
    /// Bytes of one frame: the exact size of a slot.
    pub payload_bytes: usize,
}

impl Settings {
    /// Mono8 of the sensor's upper left corner, `width` x `height` px, `fps` frames a second of `exposure_us` microseconds; no binning, no
    /// gain.
    pub const fn new(width: u32, height: u32, fps: f64, exposure_us: f64) -> Self {
        Settings {
            width,
            height,
            offset_x: 0,
            offset_y: 0,
            binning_horizontal: 1,
            binning_vertical: 1,
            pixel_format: PixelFormat::Mono8,
            fps,
            exposure_us,
            gain_db: 0.0,
        }
    }

    /// Bytes of one row without padding.
    fn row_bytes(&self) -> usize {
        self.width as usize * self.pixel_format.bytes_per_pixel()
    }

    /// Bytes of one frame without row padding.
    pub fn frame_bytes(&self) -> usize {
        self.row_bytes() * self.height as usize
    }

    /// Refuses an exposure that, with the sensor's readout, is longer than the frame period: the camera would silently run
    /// at a lower rate.
    ///
    /// # Errors
    /// [`CameraError::Refused`] with the largest exposure that fits.
    pub fn check_exposure_fits(&self, readout_us: f64) -> Result<(), CameraError> {
        let largest_us = 1e6 / self.fps - readout_us;
        if self.exposure_us <= largest_us {
            return Ok(());
        }
        let remedy = if largest_us > 0.0 {
            format!("the largest exposure_us that fits at {} fps is {}", self.fps, largest_us.floor())
        } else {
            format!("no exposure fits: the readout alone allows {:.1} fps", 1e6 / readout_us)
        };
        Err(CameraError::Refused {
            setting: "exposure_us",
            asked: self.exposure_us.to_string(),
            applied: format!(
                "{:.0} us with the readout of {readout_us:.0} us, in a frame period of {:.0} us",
                self.exposure_us + readout_us,
                1e6 / self.fps
            ),
            remedy,
        })
    }

    /// Refuses binning, for a camera that has no sensor.
    ///
    /// # Errors
    /// [`CameraError::Refused`].
    pub fn check_not_binned(&self) -> Result<(), CameraError> {
        verify("binning_horizontal", f64::from(self.binning_horizontal), 1.0, 0.0)?;
        verify("binning_vertical", f64::from(self.binning_vertical), 1.0, 0.0)
    }
}

impl Applied {
    /// What a camera applies that gives exactly what it is asked for, in rows without padding.
    pub fn exactly(settings: &Settings) -> Self {
        Applied {
            width: settings.width,
            height: settings.height,
            stride: settings.row_bytes() as u32,
            pixel_format: settings.pixel_format,
            fps: settings.fps,
            exposure_us: settings.exposure_us,
            gain_db: settings.gain_db,
            payload_bytes: settings.frame_bytes(),
        }
    }
}

/// The difference of exposure times that passes for rounding, microseconds: one of them, or 1 %.
pub fn exposure_tolerance_us(exposure_us: f64) -> f64 {
    (0.01 * exposure_us).max(1.0)
}

/// The difference of gains that passes for rounding, decibels.
pub const GAIN_TOLERANCE_DB: f64 = 0.1;

/// The difference of frame rates that passes for rounding, frames a second: 0.5 %. Devices round the period to whole sensor lines, or
/// have a few rates and name them in units of their own.
pub fn frame_rate_tolerance(fps: f64) -> f64 {
    0.005 * fps
}

/// Refuses a setting that reads back as another value than was asked, beyond what passes for rounding.
///
/// # Errors
/// [`CameraError::Refused`] with both values.
pub fn verify(setting: &'static str, asked: f64, applied: f64, tolerance: f64) -> Result<(), CameraError> {
    // The last digits of a float conversion come on top.
    if (asked - applied).abs() <= tolerance.abs() + asked.abs() * 1e-6 + 1e-9 {
        return Ok(());
    }
    Err(CameraError::Refused {
        setting,
        asked: asked.to_string(),
        applied: applied.to_string(),
        remedy: format!("set {setting} = {applied}, or another value that the device can apply"),
    })
}
