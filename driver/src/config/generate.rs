//! `[camera.generate]`

use std::ops::RangeInclusive;

use serde::Deserialize;
use toml::Spanned;
use uvcam_masker::generate::{CameraPlace, IgnoredRegion, LEAF_SIZES, Parameters};

use super::reader::{EXPOSURE, GAIN, Reader};
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
        let published = Parameters::default();
        let sigma =
            self.value_or("sigma", table.sigma, published.sigma.into(), "0 to 255", |sigma| *sigma <= 255)?;
        let parameters = Parameters {
            sigma: u8::try_from(sigma).unwrap_or(u8::MAX),
            eta: self.value_or(
                "eta",
                table.eta,
                published.eta,
                &range(&Parameters::ETA, "pixels"),
                |eta| Parameters::ETA.contains(eta),
            )?,
            leaf: self.value_or(
                "leaf",
                table.leaf,
                published.leaf,
                &format!("one of {LEAF_SIZES:?}"),
                |leaf| LEAF_SIZES.contains(leaf),
            )?,
            k: self.value_or("k", table.k, published.k, &range(&Parameters::K, "points"), |k| {
                Parameters::K.contains(k)
            })?,
            tau: self.value_or(
                "tau",
                table.tau,
                published.tau,
                &format!("a distance in pixels above 0, at most {}", Parameters::LARGEST_TAU),
                |tau| *tau > 0.0 && *tau <= Parameters::LARGEST_TAU,
            )?,
            kappa: self.value_or(
                "kappa",
                table.kappa,
                published.kappa,
                &range(&Parameters::KAPPA, "pixels"),
                |kappa| Parameters::KAPPA.contains(kappa),
            )?,
        };
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
        Ok(Generate {
            exposure_us: self.value_or(
                "exposure_us",
                table.exposure_us,
                default.exposure_us,
                EXPOSURE,
                |us| (1.0..=1e7).contains(us),
            )?,
            gain_db: self.value_or("gain_db", table.gain_db, default.gain_db, GAIN, |db| {
                (-40.0..=80.0).contains(db)
            })?,
            ignored,
            parameters,
        })
    }
}

fn range(range: &RangeInclusive<u32>, unit: &str) -> String {
    format!("{} to {} {unit}", range.start(), range.end())
}
