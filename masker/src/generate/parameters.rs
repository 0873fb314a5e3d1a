//! Parameters of mask generation.

use std::error::Error;
use std::fmt;
use std::ops::RangeInclusive;

/// Bucket sizes of the k-d tree that [`Parameters::leaf`] may name.
pub const LEAF_SIZES: [u32; 4] = [5, 10, 20, 40];

/// Parameters of mask generation, with their symbols in "Towards Scalable and Fast UAV Deployment".
///
/// Every value within the ranges gives a mask of the whole airframe, or a refusal, within seconds.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// sigma: a pixel brighter than this is a candidate; 8-bit grey value, 0 to 255.
    pub sigma: u8,
    /// eta: the mask needs more candidates than this; number of pixels, in the range [`Parameters::ETA`].
    pub eta: u32,
    /// Bucket size of the k-d tree in points, one of [`LEAF_SIZES`]. Matters for speed alone.
    pub leaf: u32,
    /// k: neighbours that are connected with each candidate, itself included; in the range [`Parameters::K`].
    pub k: u32,
    /// tau: only neighbours nearer than this are connected; pixels, above 0 and at most [`Parameters::LARGEST_TAU`].
    pub tau: f64,
    /// kappa: thickness of the drawn contours, so the mask grows by half of it; pixels, in the range [`Parameters::KAPPA`].
    pub kappa: u32,
}

impl Default for Parameters {
    /// The published values.
    fn default() -> Self {
        Self { sigma: 120, eta: 20, leaf: 10, k: 20, tau: 50.0, kappa: 50 }
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParameterError {
    /// Brighter than a pixel can be.
    Sigma {
        /// The value given.
        sigma: u32,
    },
    /// What the fused method drops as specks could be an arm.
    Eta {
        /// The value given.
        eta: u32,
    },
    /// The bucket size has no tree.
    Leaf {
        /// The value given.
        leaf: u32,
    },
    /// No neighbours, or too many to be local.
    K {
        /// The value given.
        k: u32,
    },
    /// The distance is none, or no longer that of neighbours.
    Tau {
        /// The value given.
        tau: f64,
    },
    /// The mask would grow over most of the image.
    Kappa {
        /// The value given.
        kappa: u32,
    },
}

impl ParameterError {
    /// The parameter's name, as the field of [`Parameters`].
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sigma { .. } => "sigma",
            Self::Eta { .. } => "eta",
            Self::Leaf { .. } => "leaf",
            Self::K { .. } => "k",
            Self::Tau { .. } => "tau",
            Self::Kappa { .. } => "kappa",
        }
    }

    /// The value given.
    pub fn found(&self) -> String {
        match self {
            Self::Sigma { sigma: value }
            | Self::Eta { eta: value }
            | Self::Leaf { leaf: value }
            | Self::K { k: value }
            | Self::Kappa { kappa: value } => value.to_string(),
            Self::Tau { tau } => tau.to_string(),
        }
    }

    /// What can be given.
    pub fn allowed(&self) -> String {
        let range = |range: RangeInclusive<u32>| format!("{} to {}", range.start(), range.end());
        match self {
            Self::Sigma { .. } => range(Parameters::SIGMA),
            Self::Eta { .. } => range(Parameters::ETA) + " pixels",
            Self::Leaf { .. } => format!("one of {LEAF_SIZES:?}"),
            Self::K { .. } => range(Parameters::K) + " points, the candidate itself included",
            Self::Tau { .. } => {
                format!("a distance in pixels above 0, at most {}", Parameters::LARGEST_TAU)
            }
            Self::Kappa { .. } => range(Parameters::KAPPA) + " pixels",
        }
    }
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {}; give {}", self.name(), self.found(), self.allowed())
    }
}

impl Error for ParameterError {}

impl Parameters {
    /// Range of sigma: 8-bit grey values.
    pub const SIGMA: RangeInclusive<u32> = 0..=u8::MAX as u32;
    /// Range of eta, pixels: 50 times the published value, and less than any part of an airframe.
    pub const ETA: RangeInclusive<u32> = 0..=1000;
    /// Range of k, points: five times the published value; the time that it takes grows with its cube.
    pub const K: RangeInclusive<u32> = 1..=100;
    /// The largest tau, pixels: 20 times the published value.
    pub const LARGEST_TAU: f64 = 1000.0;
    /// Range of kappa, pixels: six times the published value grows a mask by 150 px.
    pub const KAPPA: RangeInclusive<u32> = 0..=300;

    /// How far growth reaches from a candidate at most, in pixels.
    pub(super) fn reach(&self) -> u32 {
        self.kappa.div_ceil(2)
    }

    /// The grey value of a number that was given for sigma.
    ///
    /// # Errors
    /// [`ParameterError::Sigma`] where a pixel cannot have it.
    pub fn sigma_from(sigma: u32) -> Result<u8, ParameterError> {
        u8::try_from(sigma).map_err(|_| ParameterError::Sigma { sigma })
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`ParameterError`] for the first parameter that is out of its range.
    pub fn check(&self) -> Result<(), ParameterError> {
        let Self { sigma: _, eta, leaf, k, tau, kappa } = *self;
        if !Self::ETA.contains(&eta) {
            Err(ParameterError::Eta { eta })
        } else if !LEAF_SIZES.contains(&leaf) {
            Err(ParameterError::Leaf { leaf })
        } else if !Self::K.contains(&k) {
            Err(ParameterError::K { k })
        } else if !(tau > 0.0 && tau <= Self::LARGEST_TAU) {
            Err(ParameterError::Tau { tau })
        } else if !Self::KAPPA.contains(&kappa) {
            Err(ParameterError::Kappa { kappa })
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_ranges_are_within_and_what_is_beyond_is_named_with_value_and_range() {
        let published = Parameters::default();
        let message = |parameters: Parameters| parameters.check().map_err(|error| error.to_string());
        let [eta, k] = [
            |eta| Parameters { eta, ..Parameters::default() },
            |k| Parameters { k, ..Parameters::default() },
        ];
        let kappa = |kappa| Parameters { kappa, ..published.clone() };
        let tau = |tau| Parameters { tau, ..published.clone() };
        let leaf = |leaf| Parameters { leaf, ..published.clone() };
        let within =
            [eta(0), eta(1000), k(1), k(100), kappa(0), kappa(300), tau(f64::MIN_POSITIVE), tau(1000.0)];
        for parameters in within.into_iter().chain(LEAF_SIZES.map(leaf)) {
            assert_eq!(message(parameters.clone()), Ok(()), "{parameters:?}");
        }
        for (parameters, expected) in [
            (eta(1001), "eta is 1001; give 0 to 1000 pixels"),
            (k(0), "k is 0; give 1 to 100 points, the candidate itself included"),
            (k(101), "k is 101; give 1 to 100 points, the candidate itself included"),
            (kappa(2000), "kappa is 2000; give 0 to 300 pixels"),
            (leaf(7), "leaf is 7; give one of [5, 10, 20, 40]"),
            (tau(0.0), "tau is 0; give a distance in pixels above 0, at most 1000"),
            (tau(-1.0), "tau is -1; give a distance in pixels above 0, at most 1000"),
            (tau(f64::NAN), "tau is NaN; give a distance in pixels above 0, at most 1000"),
            (tau(f64::INFINITY), "tau is inf; give a distance in pixels above 0, at most 1000"),
        ] {
            assert_eq!(message(parameters), Err(expected.to_owned()));
        }
    }

    #[test]
    fn sigma_is_a_grey_value() {
        assert_eq!((Parameters::sigma_from(0), Parameters::sigma_from(255)), (Ok(0), Ok(255)));
        let error = Parameters::sigma_from(256).unwrap_err();
        assert_eq!(error.to_string(), "sigma is 256; give 0 to 255");
    }
}
