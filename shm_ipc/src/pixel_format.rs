//! Pixel formats by their PFNC code (GenICam Pixel Format Naming Convention).

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// A monochrome pixel format. The number is its PFNC code, as cameras report it and [`FrameHeader`](crate::FrameHeader) carries it.
///
/// Pixels of more than 8 bits lie in 16-bit little-endian words, value in the low bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PixelFormat {
    /// 8 bits in one byte.
    Mono8 = 0x0108_0001,
    /// 10 bits in two bytes.
    Mono10 = 0x0110_0003,
    /// 12 bits in two bytes.
    Mono12 = 0x0110_0005,
    /// 16 bits in two bytes.
    Mono16 = 0x0110_0007,
}

/// A pixel format that is not part of the contract.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("pixel format {0} is not known: use Mono8, Mono10, Mono12 or Mono16")]
pub struct UnknownPixelFormat(String);

impl PixelFormat {
    /// Every pixel format of the contract.
    pub const ALL: [PixelFormat; 4] =
        [PixelFormat::Mono8, PixelFormat::Mono10, PixelFormat::Mono12, PixelFormat::Mono16];

    /// The PFNC code.
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// The format of a PFNC code, or `None` where it is not part of the contract.
    pub fn from_code(code: u32) -> Option<PixelFormat> {
        PixelFormat::ALL.into_iter().find(|format| format.code() == code)
    }

    /// Bytes that one pixel takes in memory.
    pub const fn bytes_per_pixel(self) -> usize {
        match self {
            PixelFormat::Mono8 => 1,
            PixelFormat::Mono10 | PixelFormat::Mono12 | PixelFormat::Mono16 => 2,
        }
    }

    /// Bits of the value; the bits above them are zero.
    pub const fn significant_bits(self) -> u32 {
        match self {
            PixelFormat::Mono8 => 8,
            PixelFormat::Mono10 => 10,
            PixelFormat::Mono12 => 12,
            PixelFormat::Mono16 => 16,
        }
    }

    /// The PFNC name, as in the GenICam feature `PixelFormat`.
    pub const fn name(self) -> &'static str {
        match self {
            PixelFormat::Mono8 => "Mono8",
            PixelFormat::Mono10 => "Mono10",
            PixelFormat::Mono12 => "Mono12",
            PixelFormat::Mono16 => "Mono16",
        }
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for PixelFormat {
    type Err = UnknownPixelFormat;

    fn from_str(name: &str) -> Result<Self, UnknownPixelFormat> {
        let known = PixelFormat::ALL.into_iter().find(|format| format.name() == name);
        known.ok_or_else(|| UnknownPixelFormat(format!("\"{name}\"")))
    }
}

impl TryFrom<u32> for PixelFormat {
    type Error = UnknownPixelFormat;

    fn try_from(code: u32) -> Result<Self, UnknownPixelFormat> {
        PixelFormat::from_code(code).ok_or_else(|| UnknownPixelFormat(format!("{code:#010x}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_and_name_lead_back_to_the_format() {
        for format in PixelFormat::ALL {
            assert_eq!(PixelFormat::try_from(format.code()), Ok(format));
            assert_eq!(format.to_string().parse(), Ok(format));
        }
    }

    #[test]
    fn bytes_per_pixel_agrees_with_the_code() {
        for format in PixelFormat::ALL {
            // PFNC: bits 16 to 23 of the code are the bits that a pixel occupies.
            assert_eq!(format.bytes_per_pixel() * 8, (format.code() >> 16 & 0xff) as usize);
        }
    }

    #[test]
    fn unknown_formats_are_named_in_the_error() {
        assert!("mono8".parse::<PixelFormat>().unwrap_err().to_string().contains("\"mono8\""));
        assert!(PixelFormat::try_from(0x0108_0009).unwrap_err().to_string().contains("0x01080009"));
    }
}
