//! What may be asked for, in one place for whoever checks it and for whoever says it.

use std::fmt;

/// Values from `least` to `most`, both included, of a `unit`. Prints itself as a message names it: `1 to 255 frames`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<T> {
    /// The least value.
    pub least: T,
    /// The greatest value.
    pub most: T,
    /// Of what, in the plural.
    pub unit: &'static str,
}

/// Exposure times that a camera can be asked for.
pub const EXPOSURE_US: Bounds<f64> = Bounds { least: 1.0, most: 1e7, unit: "microseconds" };
/// Gains that a camera can be asked for.
pub const GAIN_DB: Bounds<f64> = Bounds { least: -40.0, most: 80.0, unit: "decibels" };
/// Frames that a mask can be generated from at most: as many as a byte counts.
pub const FRAMES: Bounds<u32> = Bounds { least: 1, most: 255, unit: "frames" };

impl<T: PartialOrd> Bounds<T> {
    /// Whether the value is one of them; NaN never is.
    pub fn contains(&self, value: &T) -> bool {
        (&self.least..=&self.most).contains(&value)
    }
}

impl<T: fmt::Display> fmt::Display for Bounds<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} to {} {}", self.least, self.most, self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_are_within_and_nothing_beyond_them() {
        for value in [1.0, 2.5, 1e7] {
            assert!(EXPOSURE_US.contains(&value), "{value}");
        }
        for value in [0.999, 1.000_001e7, -1.0, f64::NAN, f64::INFINITY] {
            assert!(!EXPOSURE_US.contains(&value), "{value}");
        }
    }

    #[test]
    fn they_are_said_with_their_unit() {
        assert_eq!(EXPOSURE_US.to_string(), "1 to 10000000 microseconds");
        assert_eq!(GAIN_DB.to_string(), "-40 to 80 decibels");
        assert_eq!(FRAMES.to_string(), "1 to 255 frames");
    }
}
