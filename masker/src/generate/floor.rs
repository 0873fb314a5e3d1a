//! The level of what the lamp does not light.

/// Number of pixels of each grey value.
pub(super) type Histogram = [u64; 256];

/// Share of the darkest pixels that certainly belong to the floor.
const CERTAIN: f64 = 0.25;
/// Share of pixels that may be darker than the floor: dead pixels, deep shadows.
const DARKER: f64 = 0.02;
/// Distance from the mean, in standard deviations, beyond which a pixel is no longer counted as floor.
const CLIP: f64 = 3.0;
/// Least standard deviation: grey values are whole numbers.
const LEAST_DEVIATION: f64 = 1.0;
/// The estimate settles within a few rounds; this many end it in any case.
const MOST_ROUNDS: usize = 50;

/// Mean and standard deviation of the floor in one frame, in grey values: sensor noise and whatever light there is
/// without the lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Floor {
    mean: f64,
    deviation: f64,
}

impl Floor {
    /// Estimates the floor by sigma clipping, as astronomers estimate the sky: what is far above the mean is left out
    /// until the mean stays. The start is the darkest quarter, so the lit part may be as large as the other three.
    ///
    /// `None` where there is no pixel.
    pub(super) fn of(histogram: &Histogram) -> Option<Self> {
        let start = quantile(histogram, CERTAIN)?;
        let spread = start - quantile(histogram, DARKER)?;
        let mut floor = Self { mean: start, deviation: spread.max(LEAST_DEVIATION) };
        for _ in 0..MOST_ROUNDS {
            let limit = floor.above(CLIP);
            floor = Self::up_to(histogram, limit)?;
            if floor.above(CLIP).floor() == limit.floor() {
                break;
            }
        }
        Some(floor)
    }

    /// The grey value `deviations` standard deviations above the mean.
    pub(super) fn above(&self, deviations: f64) -> f64 {
        self.mean + deviations * self.deviation
    }

    /// Mean and standard deviation of the pixels that are at most `limit`.
    fn up_to(histogram: &Histogram, limit: f64) -> Option<Self> {
        let values = || (0..).map(f64::from).zip(histogram).take_while(|(value, _)| *value <= limit);
        let sum = |of: &dyn Fn(f64) -> f64| values().map(|(value, px)| of(value) * *px as f64).sum::<f64>();
        let px = sum(&|_| 1.0);
        let mean = (px > 0.0).then(|| sum(&|value| value) / px)?;
        let variance = sum(&|value| (value - mean).powi(2)) / px;
        Some(Self { mean, deviation: variance.sqrt().max(LEAST_DEVIATION) })
    }
}

/// The least grey value that a share of the pixels does not exceed.
pub(super) fn quantile(histogram: &Histogram, share: f64) -> Option<f64> {
    let total: u64 = histogram.iter().sum();
    let wanted = share * total as f64;
    let mut px = 0;
    let reaches = |count: &u64| {
        px += count;
        px as f64 >= wanted
    };
    (total > 0).then(|| histogram.iter().position(reaches).unwrap_or(255) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn histogram(pixels: impl IntoIterator<Item = (usize, u64)>) -> Histogram {
        let mut histogram = [0; 256];
        pixels.into_iter().for_each(|(value, px)| histogram[value] += px);
        histogram
    }

    #[test]
    fn no_pixel_has_no_floor() {
        assert_eq!(Floor::of(&[0; 256]), None);
    }

    #[test]
    fn a_lit_part_does_not_lift_the_floor() {
        let floor = || (6..=20).map(|value| (value, 100));
        let alone = Floor::of(&histogram(floor())).unwrap();
        for lit in [1, 100, 4000] {
            let found = Floor::of(&histogram(floor().chain([(80, lit / 2), (255, lit / 2)]))).unwrap();
            assert_eq!(found, alone, "{lit} px lit of {}", 1500 + lit);
        }
        assert!((alone.mean - 13.0).abs() < 0.01 && (alone.deviation - 4.32).abs() < 0.01, "{alone:?}");
    }

    #[test]
    fn a_floor_without_noise_has_the_noise_of_rounding() {
        let floor = Floor::of(&histogram([(30, 1000)])).unwrap();
        assert_eq!((floor.above(0.0), floor.above(1.0)), (30.0, 31.0));
    }

    #[test]
    fn quantiles_count_pixels() {
        let histogram = histogram([(1, 50), (9, 49), (200, 1)]);
        assert_eq!(quantile(&histogram, 0.5), Some(1.0));
        assert_eq!(quantile(&histogram, 0.51), Some(9.0));
        assert_eq!(quantile(&histogram, 1.0), Some(200.0));
    }
}
