//! `[camera.generate]`

use serde::Deserialize;
use toml::Spanned;
use uvcam_masker::generate::{CameraPlace, IgnoredRegion, ParameterError, Parameters};
use uvcam_shm_ipc::control::{EXPOSURE_US, GAIN_DB};

use super::error::shortened;
use super::reader::Reader;
use super::{ConfigError, Generate};
use crate::camera::Settings;

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct GenerateTable {
    exposure_us: Option<Spanned<f64>>,
    gain_db: Option<Spanned<f64>>,
    camera_place: Option<Spanned<String>>,
    ignore: Option<Vec<Spanned<String>>>,
    ignore_polygons: Option<Vec<Vec<Spanned<Vec<u32>>>>>,
    sigma: Option<Spanned<u32>>,
    eta: Option<Spanned<u32>>,
    leaf: Option<Spanned<u32>>,
    k: Option<Spanned<u32>>,
    tau: Option<Spanned<f64>>,
    kappa: Option<Spanned<u32>>,
}

impl Reader<'_> {
    pub(super) fn generate(
        &self,
        table: GenerateTable,
        settings: &Settings,
    ) -> Result<Generate, ConfigError> {
        let default = Generate::default();
        let parameters = self.parameters(&table)?;
        let mut ignored = match table.camera_place {
            None => IgnoredRegion::default(),
            Some(place) => {
                let preset = match place.get_ref().as_str() {
                    "left" => CameraPlace::Left,
                    "right" => CameraPlace::Right,
                    "back" => CameraPlace::Back,
                    other => {
                        let allowed = "\"left\", \"right\" or \"back\"";
                        return Err(self.0.refuse(
                            place.span(),
                            "camera_place",
                            format!("\"{other}\""),
                            allowed,
                        ));
                    }
                };
                IgnoredRegion::preset(preset, settings.width, settings.height)
            }
        };
        for text in table.ignore.unwrap_or_default() {
            let allowed = "x0:x1:y0:y1 in pixels, an empty end for the image border";
            let found = || format!("\"{}\"", text.get_ref());
            let rectangle = text.get_ref().parse();
            ignored
                .rectangles
                .push(rectangle.map_err(|_| self.0.refuse(text.span(), "ignore", found(), allowed))?);
        }
        for polygon in table.ignore_polygons.unwrap_or_default() {
            let points = polygon.iter().map(|point| match point.get_ref().as_slice() {
                [x, y] => Ok((*x, *y)),
                other => {
                    let found = format!("{} numbers", other.len());
                    Err(self.0.refuse(
                        point.span(),
                        "ignore_polygons",
                        found,
                        "[x, y] in pixels for each point",
                    ))
                }
            });
            ignored.polygons.push(points.collect::<Result<_, _>>()?);
        }
        let exposure_us = table.exposure_us.map(|time| self.within("exposure_us", time, &EXPOSURE_US));
        let gain_db = table.gain_db.map(|gain| self.within("gain_db", gain, &GAIN_DB));
        Ok(Generate {
            exposure_us: exposure_us.unwrap_or(Ok(default.exposure_us))?,
            gain_db: gain_db.unwrap_or(Ok(default.gain_db))?,
            ignored,
            parameters,
        })
    }

    /// The parameters of the methods, which know their own bounds.
    fn parameters(&self, table: &GenerateTable) -> Result<Parameters, ConfigError> {
        let places = [
            ("sigma", table.sigma.as_ref().map(Spanned::span)),
            ("eta", table.eta.as_ref().map(Spanned::span)),
            ("leaf", table.leaf.as_ref().map(Spanned::span)),
            ("k", table.k.as_ref().map(Spanned::span)),
            ("tau", table.tau.as_ref().map(Spanned::span)),
            ("kappa", table.kappa.as_ref().map(Spanned::span)),
        ];
        let refused = |error: ParameterError| {
            let place = places.iter().find(|(name, _)| *name == error.name());
            let span = place.and_then(|(_, place)| place.clone()).unwrap_or_default();
            self.0.refuse(span, error.name(), shortened(&error.found()), &error.allowed())
        };
        let published = Parameters::default();
        let or = |value: &Option<Spanned<u32>>, published| {
            value.as_ref().map_or(published, |value| *value.get_ref())
        };
        let parameters = Parameters {
            sigma: Parameters::sigma_from(or(&table.sigma, published.sigma.into())).map_err(refused)?,
            eta: or(&table.eta, published.eta),
            leaf: or(&table.leaf, published.leaf),
            k: or(&table.k, published.k),
            tau: table.tau.as_ref().map_or(published.tau, |tau| *tau.get_ref()),
            kappa: or(&table.kappa, published.kappa),
        };
        parameters.check().map_err(refused)?;
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::RangeInclusive;

    use uvcam_masker::generate::LEAF_SIZES;

    use super::*;
    use crate::config::{Config, DEFAULT};

    fn refusal(key: &str, value: &str) -> String {
        let text = format!(
            "[[camera]]\nname = \"left\"\nsource = {{ kind = \"simulated\", serial = \"A\" }}\nwidth = 752\nheight = 480\n\
             fps = 60\nexposure_us = 1000\n[camera.generate]\n{key} = {value}\n"
        );
        Config::parse(&text, "uvcam.toml".as_ref()).unwrap_err().to_string()
    }

    #[test]
    fn each_key_out_of_its_bounds_is_refused_with_line_value_and_bounds() {
        for (key, value, expected) in [
            ("exposure_us", "0", "found 0; allowed: 1 to 10000000 microseconds"),
            ("gain_db", "81", "found 81; allowed: -40 to 80 decibels"),
            ("sigma", "256", "found 256; allowed: 0 to 255"),
            ("eta", "1001", "found 1001; allowed: 0 to 1000 pixels"),
            ("leaf", "7", "found 7; allowed: one of [5, 10, 20, 40]"),
            ("k", "0", "found 0; allowed: 1 to 100 points, the candidate itself included"),
            ("tau", "0.0", "found 0; allowed: a distance in pixels above 0, at most 1000"),
            ("kappa", "301", "found 301; allowed: 0 to 300 pixels"),
        ] {
            assert_eq!(refusal(key, value), format!("uvcam.toml:9: {key}: {expected}"));
        }
    }

    #[test]
    fn the_manual_tells_the_bounds() {
        let range = |range: RangeInclusive<u32>| format!("{} to {}", range.start(), range.end());
        let [.., largest] = LEAF_SIZES;
        for said in [
            format!("sigma is a candidate, {}", range(Parameters::SIGMA)),
            format!("than eta, {}", range(Parameters::ETA)),
            format!("5, 10, 20 or {largest}"),
            format!("k from {}", range(Parameters::K)),
            format!("tau up to {}", Parameters::LARGEST_TAU),
            format!("contours, {} pixels", range(Parameters::KAPPA)),
        ] {
            assert!(DEFAULT.contains(&said), "{said}");
        }
    }
}
