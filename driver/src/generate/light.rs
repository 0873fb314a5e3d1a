//! The light that frames were taken in.

use crate::camera::{Applied, Identity};

/// Where lit frames came from, and in what light.
#[derive(Debug, Clone)]
pub(super) struct Light {
    /// The camera.
    pub(super) identity: Identity,
    /// What it applied, as read back.
    pub(super) applied: Applied,
}

impl Light {
    /// Keywords and texts that tell of it, for the mask's file.
    pub(super) fn provenance(&self) -> Vec<(&'static str, String)> {
        let Light { identity, applied } = self;
        vec![
            ("Camera", format!("{} {}", identity.vendor, identity.model)),
            ("Camera Serial", identity.serial.clone()),
            ("Size", format!("{}x{}", applied.width, applied.height)),
            ("Exposure us", applied.exposure_us.to_string()),
            ("Gain dB", applied.gain_db.to_string()),
        ]
    }
}
