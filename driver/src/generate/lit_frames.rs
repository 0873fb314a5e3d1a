//! What a camera's thread hands over when it has collected enough.

use super::candidate::Generated;
use super::generator::Generator;
use super::light::Light;
use crate::error::Error;

/// Lit frames, in the generator that has seen them, and the light that they were taken in.
#[derive(Debug)]
pub struct LitFrames {
    generator: Generator,
    light: Light,
}

impl LitFrames {
    pub(super) fn new(generator: Generator, light: Light) -> Self {
        LitFrames { generator, light }
    }

    /// Makes the mask from them.
    ///
    /// # Errors
    /// [`Error::Generate`] where it cannot be computed; [`Error::Usage`] where there are no frames.
    pub fn generate(self) -> Result<Generated, Error> {
        let exposure_us = self.light.applied.exposure_us;
        let generated = self.generator.finish(Some(exposure_us))?;
        Ok(Generated { light: Some(self.light), ..generated })
    }

    /// The serial of the camera that they came from.
    #[cfg(test)]
    pub(crate) fn serial(&self) -> &str {
        &self.light.identity.serial
    }
}
