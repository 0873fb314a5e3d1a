//! Parameters of mask generation.

use thiserror::Error;

use super::neighbours::LEAF_SIZES;

/// Largest k that is searched for; beyond it a neighbourhood is no longer local.
const LARGEST_K: u32 = 1000;

/// Parameters of mask generation, with their symbols in "Towards Scalable and Fast UAV Deployment".
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// sigma: a pixel brighter than this is a candidate; 8-bit grey value.
    pub sigma: u8,
    /// eta: the mask needs more candidates than this; number of pixels.
    pub eta: u32,
    /// Bucket size of the k-d tree in points, one of [`LEAF_SIZES`]. Matters for speed alone.
    pub leaf: u32,
    /// k: neighbours that are connected with each candidate, itself included; 1 to 1000.
    pub k: u32,
    /// tau: only neighbours nearer than this are connected; pixels, above 0.
    pub tau: f64,
    /// kappa: thickness of the drawn contours, so the mask grows by half of it; pixels.
    pub kappa: u32,
}

impl Default for Parameters {
    /// The published values.
    fn default() -> Self {
        Self { sigma: 120, eta: 20, leaf: 10, k: 20, tau: 50.0, kappa: 50 }
    }
}

/// A parameter out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ParameterError {
    /// The bucket size has no tree.
    #[error("leaf is {leaf}; give one of {LEAF_SIZES:?}")]
    Leaf {
        /// The value given.
        leaf: u32,
    },
    /// No or too many neighbours.
    #[error("k is {k}; give 1 to {LARGEST_K}, the candidate itself included")]
    K {
        /// The value given.
        k: u32,
    },
    /// The distance is none.
    #[error("tau is {tau}; give a distance in pixels above 0")]
    Tau {
        /// The value given.
        tau: f64,
    },
}

impl Parameters {
    /// How far growth reaches from a candidate at most, in pixels.
    pub(super) fn reach(&self) -> u32 {
        self.kappa.div_ceil(2)
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`ParameterError`] for the first parameter that is out of its range.
    pub fn check(&self) -> Result<(), ParameterError> {
        let Self { leaf, k, tau, .. } = *self;
        if !LEAF_SIZES.contains(&leaf) {
            Err(ParameterError::Leaf { leaf })
        } else if !(1..=LARGEST_K).contains(&k) {
            Err(ParameterError::K { k })
        } else if tau.is_nan() || tau <= 0.0 {
            Err(ParameterError::Tau { tau })
        } else {
            Ok(())
        }
    }
}
