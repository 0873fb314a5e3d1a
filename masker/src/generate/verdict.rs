//! What is to be said about a mask that was made, or about why there is none.

use std::fmt;

use super::Rectangle;
use crate::check::Severity;

/// How a mask is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// The published method on one frame; refuses by equation 6, and what masks more than nine tenths.
    Paper,
    /// Several frames while the lamp moves.
    #[default]
    Fused,
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Paper => "paper",
            Self::Fused => "fused",
        })
    }
}

/// Something to know about the frames or the mask, with what to change.
#[derive(Debug, Clone, PartialEq)]
pub enum Finding {
    /// Too few candidates (equation 6).
    TooDark {
        /// Number of candidates, |P|.
        candidates: usize,
        /// More than this are needed, eta.
        eta: u32,
        /// Grey value of the brightest light seen.
        level: u8,
    },
    /// There is light on the airframe, but too little to be told from the floor all over it.
    TooWeak {
        /// Typical grey value of what is lit.
        level: u8,
    },
    /// There is enough light on some of the airframe, but more pixels are neither dark nor clearly lit.
    Unclear {
        /// Their number.
        uncertain_px: usize,
        /// Number of clearly lit ones.
        candidates: usize,
        /// Where they are.
        place: Rectangle,
    },
    /// What the lamp does not light is too bright itself.
    OverExposed {
        /// Upper bound of its grey value; above 255 where it cannot be told from light.
        floor: u32,
        /// Frames that were of no use for that.
        lost_frames: u32,
    },
    /// The lamp, or its glow, is in the part of the image where the airframe is looked for: light fades out over many
    /// pixels, while an airframe has edges.
    LampInside {
        /// Pixels on the slope.
        slope_px: usize,
        /// Where they are.
        place: Rectangle,
    },
    /// Something as large as an airframe's parts was lit in too few frames to count.
    Unstable {
        /// Its pixels.
        unsure_px: usize,
        /// Where they are.
        place: Rectangle,
        /// Frames in which a pixel must be lit to count.
        needed: u32,
    },
    /// There are more passing reflections than so few frames can tell from the airframe.
    TooFewFrames {
        /// Number of frames.
        frames: u32,
    },
    /// No part of the mask touches the border of the image or the ignored region, as arms do.
    TouchesNothing {
        /// Masked pixels.
        masked_px: u64,
    },
    /// One part of the mask touches neither the border of the image nor the ignored region, so it may be no arm.
    Detached {
        /// Number of its pixels.
        area_px: u64,
        /// Its bounding box.
        place: Rectangle,
    },
    /// More than half of the image is masked.
    OverHalfMasked {
        /// Masked pixels.
        masked_px: u64,
        /// All pixels.
        total_px: u64,
    },
    /// The mask in force for this camera is very different.
    Different {
        /// Masked pixels of both over those of either, 0 to 1.
        overlap: f64,
    },
}

/// Grey value at which an airframe is well lit: midway between the published sigma and saturation.
const WELL_LIT: f64 = 187.0;
/// Grey value that the floor should not exceed: half of the published sigma.
const DIM_FLOOR: f64 = 60.0;
/// Where light is missing, less than this factor of exposure is not worth another try.
const LEAST_STEP: f64 = 2.0;

impl Finding {
    /// What was found and what to change. Advises an exposure time where `exposure_us`, that of the frames in
    /// microseconds, is known, and else by how much to change it.
    #[must_use]
    pub fn message(&self, exposure_us: Option<f64>) -> String {
        let expose = |factor: f64| match exposure_us {
            Some(us) => format!("to about {} us", two_digits(us * factor)),
            None => format!("to about {} times its value", two_digits(factor)),
        };
        let brighten = |level: &u8| expose((WELL_LIT / f64::from((*level).max(1))).max(LEAST_STEP));
        match self {
            Self::TooDark { candidates, eta, level } => format!(
                "too dark: {candidates} candidate pixels where more than eta = {eta} are needed, and the brightest \
                 light is at grey value {level}; switch the lamp on, move it nearer, or raise the exposure {}",
                brighten(level)
            ),
            Self::TooWeak { level } => format!(
                "too weak: the light on the airframe is at grey value {level}, not far enough above the dark; raise the \
                 exposure {}, or move the lamp nearer",
                brighten(level)
            ),
            Self::Unclear { uncertain_px, candidates, place } => format!(
                "unclear: {candidates} pixels are clearly lit, but {uncertain_px} pixels in {place} are neither dark nor \
                 clearly lit; where the airframe is there, move the lamp over all of it or raise the exposure; where it \
                 is not, darken what is behind it or extend the ignored region"
            ),
            Self::OverExposed { floor, lost_frames } => format!(
                "over-exposed: without the lamp's light the image reaches grey value {floor}, too much in \
                 {lost_frames} frames; lower the exposure {}, or darken the room",
                expose(DIM_FLOOR / f64::from((*floor).max(1)))
            ),
            Self::LampInside { slope_px, place } => format!(
                "lamp inside the mask region: its glow fades out over {slope_px} pixels in {place}; move the lamp away \
                 from the airframe, or extend the ignored region over them; where an arm is there, light it better"
            ),
            Self::Unstable { unsure_px, place, needed } => format!(
                "unstable between frames: {unsure_px} pixels in {place} were lit, but in fewer than {needed} frames; \
                 move the lamp more slowly, or take more frames; where that was the lamp itself or its glow, extend the \
                 ignored region over it"
            ),
            Self::TooFewFrames { frames } => format!(
                "too few frames: {frames} cannot tell the airframe from as much passing light; take more, and move the \
                 lamp between them"
            ),
            Self::TouchesNothing { masked_px } => format!(
                "the mask of {masked_px} pixels touches neither the image border nor the ignored region, so it is no \
                 arm; light the airframe, and remove what else shines"
            ),
            Self::Detached { area_px, place } => format!(
                "a part of {area_px} pixels in {place} touches neither the image border nor the ignored region; where \
                 it is a reflection, remove its source or extend the ignored region over it"
            ),
            Self::OverHalfMasked { masked_px, total_px } => format!(
                "{masked_px} of {total_px} pixels are masked, more than half; extend the ignored region over the lamp, \
                 or lower the exposure"
            ),
            Self::Different { overlap } => format!(
                "very different from the mask in force: they overlap by {:.1} %; check that this is the right camera \
                 and that it has not moved; where the airframe is another one, generate with --replace",
                overlap * 100.0
            ),
        }
    }

    /// Its name, for programs.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::TooDark { .. } => "too_dark",
            Self::TooWeak { .. } => "too_weak",
            Self::Unclear { .. } => "unclear",
            Self::OverExposed { .. } => "over_exposed",
            Self::LampInside { .. } => "lamp_inside",
            Self::Unstable { .. } => "unstable",
            Self::TooFewFrames { .. } => "too_few_frames",
            Self::TouchesNothing { .. } => "touches_nothing",
            Self::Detached { .. } => "detached",
            Self::OverHalfMasked { .. } => "over_half_masked",
            Self::Different { .. } => "different",
        }
    }

    /// What it means for a mask made by `method`.
    #[must_use]
    pub fn severity(&self, method: Method) -> Severity {
        match (method, self) {
            (_, Self::TooDark { .. }) => Severity::Refused,
            // Hardly anything is left to see, whatever the method promises.
            (_, Self::OverHalfMasked { masked_px, total_px }) if *masked_px > total_px / 10 * 9 => {
                Severity::Refused
            }
            (Method::Paper, _) | (_, Self::Detached { .. }) => Severity::Warning,
            // One frame was asked for.
            (_, Self::TooFewFrames { frames: 1 }) => Severity::Warning,
            // The airframe is saturated, and still stands out.
            (_, Self::OverExposed { lost_frames: 0, .. }) => Severity::Warning,
            _ => Severity::Refused,
        }
    }
}

/// Without advice on the exposure time in microseconds.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message(None))
    }
}

/// Everything found about the frames and the mask.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// How the mask was made.
    pub method: Method,
    /// All findings, in the order in which they are to be mended.
    pub findings: Vec<Finding>,
}

impl Verdict {
    /// Whether a finding refuses the mask.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        self.findings.iter().any(|finding| finding.severity(self.method) == Severity::Refused)
    }
}

/// The number with two significant digits; below 10 with one decimal.
fn two_digits(value: f64) -> String {
    if value < 10.0 {
        return format!("{value:.1}");
    }
    let unit = 10_f64.powf(value.log10().floor() - 1.0);
    format!("{:.0}", (value / unit).round() * unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_at_half_of_what_is_wanted_asks_for_twice_the_exposure() {
        let finding = Finding::TooWeak { level: 90 };
        assert!(
            finding.message(Some(2500.0)).contains("to about 5200 us"),
            "{}",
            finding.message(Some(2500.0))
        );
        assert!(finding.to_string().contains("to about 2.1 times its value"), "{finding}");
    }

    #[test]
    fn a_bright_floor_asks_for_less_exposure() {
        let finding = Finding::OverExposed { floor: 240, lost_frames: 3 };
        assert!(
            finding.message(Some(40_000.0)).contains("lower the exposure to about 10000 us"),
            "{finding}"
        );
    }

    #[test]
    fn a_mask_of_nearly_everything_is_refused_by_either_method() {
        let masked = |masked_px| Finding::OverHalfMasked { masked_px, total_px: 1000 };
        for (finding, method, severity) in [
            (masked(900), Method::Paper, Severity::Warning),
            (masked(901), Method::Paper, Severity::Refused),
            (masked(501), Method::Fused, Severity::Refused),
        ] {
            assert_eq!(finding.severity(method), severity, "{method}: {finding}");
        }
    }

    #[test]
    fn the_published_method_refuses_by_equation_6_alone() {
        let place = "0:9:3:5".parse().unwrap();
        let lamp = Finding::LampInside { slope_px: 900, place };
        let dark = Finding::TooDark { candidates: 20, eta: 20, level: 30 };
        for (finding, method, refused) in [
            (&lamp, Method::Paper, false),
            (&lamp, Method::Fused, true),
            (&dark, Method::Paper, true),
            (&dark, Method::Fused, true),
        ] {
            let verdict = Verdict { method, findings: vec![finding.clone()] };
            assert_eq!(verdict.is_refused(), refused, "{method}: {finding}");
        }
    }
}
