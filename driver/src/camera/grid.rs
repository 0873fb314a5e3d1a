//! The values that a device takes for a setting: from a smallest one in steps to a largest.

use super::CameraError;

/// A grid of values, in the setting's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    minimum: f64,
    maximum: f64,
    step: f64,
}

impl Grid {
    /// Of numbers as a device tells them, which need not make sense: a grid has at least one value.
    pub fn new(minimum: f64, maximum: f64, step: f64) -> Self {
        Grid { minimum, maximum: maximum.max(minimum), step }
    }

    /// The value of the grid next to `wanted`.
    pub fn nearest(&self, wanted: f64) -> f64 {
        let (below, above) = self.around(wanted);
        if wanted - below <= above - wanted { below } else { above }
    }

    /// The largest value of the grid that is not above `wanted`, or the smallest of all.
    pub fn at_most(&self, wanted: f64) -> f64 {
        self.around(wanted).0
    }

    /// The nearest value, where it differs by no more than `tolerance`.
    ///
    /// # Errors
    /// [`CameraError::Refused`] with the grid and its values next to `asked`.
    pub fn check(&self, setting: &'static str, asked: f64, tolerance: f64) -> Result<f64, CameraError> {
        let nearest = self.nearest(asked);
        if (nearest - asked).abs() <= tolerance + asked.abs() * 1e-6 + 1e-9 {
            return Ok(nearest);
        }
        let Grid { minimum, maximum, step } = *self;
        let remedy = match self.around(asked) {
            (below, above) if below == above => format!("the nearest {setting} is {}", short(below)),
            (below, above) => format!("the nearest {setting} are {} and {}", short(below), short(above)),
        };
        Err(CameraError::Refused {
            setting,
            asked: asked.to_string(),
            applied: format!("{} to {} in steps of {}", short(minimum), short(maximum), short(step)),
            remedy,
        })
    }

    /// The values of the grid on both sides of `wanted`; twice the same where it lies on the grid or beyond its ends.
    fn around(&self, wanted: f64) -> (f64, f64) {
        let steps = (wanted - self.minimum) / self.step;
        let last = ((self.maximum - self.minimum) / self.step + 1e-6).floor();
        let at = |steps: f64| self.minimum + steps.min(last).max(0.0) * self.step;
        // What a float conversion did to a value on the grid does not put it beside.
        match (steps - steps.round()).abs() < 1e-6 {
            true => (at(steps.round()), at(steps.round())),
            false => (at(steps.floor()), at(steps.ceil())),
        }
    }
}

/// A number without the digits that only computing gave it.
fn short(number: f64) -> f64 {
    let rounded = (number * 1e6).round() / 1e6;
    if rounded.is_finite() { rounded } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(grid: Grid, asked: f64, tolerance: f64) -> String {
        grid.check("exposure_us", asked, tolerance).unwrap_err().to_string()
    }

    #[test]
    fn a_value_beside_the_grid_is_refused_with_its_neighbours() {
        let grid = Grid::new(35.0, 10_010.0, 35.0);
        assert_eq!(grid.check("exposure_us", 1015.0, 1.0).unwrap(), 1015.0);
        assert_eq!(grid.check("exposure_us", 1014.5, 1.0).unwrap(), 1015.0);
        let message = refusal(grid, 1000.0, 1.0);
        assert!(
            message.contains("35 to 10010 in steps of 35; the nearest exposure_us are 980 and 1015"),
            "{message}"
        );
        assert!(refusal(grid, 10.0, 1.0).ends_with("the nearest exposure_us is 35"));
        assert!(refusal(grid, 1e9, 1.0).ends_with("the nearest exposure_us is 10010"));
    }

    #[test]
    fn what_a_refusal_names_is_on_the_grid() {
        let grid = Grid::new(f64::from(20.1_f32), 1e6, f64::from(0.3_f32));
        let message = refusal(grid, 1000.3, 0.0);
        let (_, named) = message.split_once("are ").unwrap();
        for named in named.split(" and ") {
            grid.check("exposure_us", named.parse().unwrap(), 0.0).unwrap();
        }
    }

    #[test]
    fn numbers_that_make_no_sense_stop_nothing() {
        let grid = Grid::new(100.0, -100.0, 1.0);
        assert_eq!((grid.nearest(0.0), grid.at_most(1e300)), (100.0, 100.0));
        for grid in
            [Grid::new(f64::MIN, f64::MAX, 1e-300), Grid::new(0.0, 1.0, 0.0), Grid::new(f64::NAN, 1.0, 1.0)]
        {
            let _ = (grid.nearest(10.0), grid.at_most(10.0), grid.check("gain_db", 10.0, 0.1));
        }
        assert!(Grid::new(0.0, 1.0, 0.0).check("gain_db", 0.5, 0.1).is_err());
    }

    #[test]
    fn the_largest_below_is_on_the_grid() {
        let grid = Grid::new(35.0, 10_010.0, 35.0);
        assert_eq!((grid.at_most(1000.0), grid.at_most(1015.0), grid.at_most(1.0)), (980.0, 1015.0, 35.0));
    }
}
