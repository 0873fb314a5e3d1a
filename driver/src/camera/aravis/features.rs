//! Reading and writing GenICam features, with every value read back.
//!
//! Names are those of the SFNC; older devices have some of them under other names or as another type, which [`Number`] hides.

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{DeviceError, GcFloat, GcInteger};

use crate::camera::{CameraError, Grid, told, verify};

/// The features of one opened device.
pub(super) struct Features<'a> {
    pub(super) camera: &'a aravis::Camera,
    pub(super) serial: &'a str,
}

/// A number that a configuration key asks for, under the name and type that this device has for it.
pub(super) struct Number<'a> {
    features: &'a Features<'a>,
    setting: &'static str,
    pub(super) name: &'static str,
    kind: Kind,
    /// The difference that passes for rounding.
    tolerance: f64,
    /// The step between two values, where the device tells one.
    increment: Option<f64>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Float,
    Integer,
}

impl Features<'_> {
    pub(super) fn failed(&self, error: aravis::glib::Error) -> CameraError {
        failed(self.serial, "configuring", error)
    }

    /// Whether the device has the feature and can use it in its present state.
    pub(super) fn has(&self, name: &str) -> Result<bool, CameraError> {
        self.camera.is_feature_available(name).map_err(|error| self.failed(error))
    }

    /// The entries of an enumeration that can be chosen; none where the device has no such enumeration.
    pub(super) fn entries(&self, name: &str) -> Result<Vec<String>, CameraError> {
        if !self.has(name)? {
            return Ok(Vec::new());
        }
        let entries =
            self.camera.dup_available_enumerations_as_strings(name).map_err(|error| self.failed(error))?;
        Ok(entries.iter().map(|entry| told(entry)).collect())
    }

    /// Chooses an entry of an enumeration.
    pub(super) fn choose(&self, setting: &'static str, name: &str, entry: &str) -> Result<(), CameraError> {
        let read = || self.camera.string(name).map_err(|error| self.failed(error));
        // An entry that is chosen already may be locked.
        if read()? == entry {
            return Ok(());
        }
        let entries = self.entries(name)?;
        if !entries.iter().any(|available| available == entry) {
            return Err(CameraError::Refused {
                setting,
                asked: entry.to_owned(),
                applied: entries.join(", "),
                remedy: "choose one of these".into(),
            });
        }
        self.camera.set_string(name, entry).map_err(|error| self.failed(error))?;
        let applied = read()?;
        if applied != entry {
            return Err(CameraError::Refused {
                setting,
                asked: entry.to_owned(),
                applied: told(&applied),
                remedy: format!("the camera does not let {name} be changed"),
            });
        }
        Ok(())
    }

    /// Chooses an entry where the device has the feature.
    pub(super) fn choose_where_present(&self, name: &'static str, entry: &str) -> Result<(), CameraError> {
        match self.has(name)? {
            true => self.choose(name, name, entry),
            false => Ok(()),
        }
    }

    /// Switches a boolean where the device has it.
    pub(super) fn switch_where_present(&self, name: &'static str, on: bool) -> Result<(), CameraError> {
        let read = || self.camera.boolean(name).map_err(|error| self.failed(error));
        if !self.has(name)? || read()? == on {
            return Ok(());
        }
        self.camera.set_boolean(name, on).map_err(|error| self.failed(error))?;
        match read()? == on {
            true => Ok(()),
            false => Err(CameraError::Refused {
                setting: name,
                asked: on.to_string(),
                applied: (!on).to_string(),
                remedy: "the camera does not let it be changed".into(),
            }),
        }
    }

    /// The first of `names` that the device has as a number. `tolerance` is the difference that passes for rounding.
    pub(super) fn number(
        &self,
        setting: &'static str,
        names: &[&'static str],
        tolerance: f64,
    ) -> Result<Option<Number<'_>>, CameraError> {
        for &name in names {
            let Some(kind) = self.kind(name) else { continue };
            if !self.has(name)? {
                continue;
            }
            let told = match kind {
                // Not every node defines an increment; the library then answers with an error or the smallest number.
                Kind::Float => self.camera.float_increment(name).ok(),
                Kind::Integer => self.camera.integer_increment(name).ok().map(|step| step as f64),
            };
            let increment = told.filter(|step| *step > f64::MIN_POSITIVE);
            return Ok(Some(Number { features: self, setting, name, kind, tolerance, increment }));
        }
        Ok(None)
    }

    fn kind(&self, name: &str) -> Option<Kind> {
        let node = self.camera.device()?.feature(name)?;
        if node.dynamic_cast_ref::<GcFloat>().is_some() {
            return Some(Kind::Float);
        }
        node.dynamic_cast_ref::<GcInteger>().map(|_| Kind::Integer)
    }
}

impl Number<'_> {
    fn failed(&self, error: aravis::glib::Error) -> CameraError {
        self.features.failed(error)
    }

    pub(super) fn read(&self) -> Result<f64, CameraError> {
        let camera = self.features.camera;
        match self.kind {
            Kind::Float => camera.float(self.name),
            Kind::Integer => camera.integer(self.name).map(|value| value as f64),
        }
        .map_err(|error| self.failed(error))
    }

    /// Smallest and largest value in the device's present state.
    pub(super) fn bounds(&self) -> Result<(f64, f64), CameraError> {
        let camera = self.features.camera;
        match self.kind {
            Kind::Float => camera.float_bounds(self.name),
            Kind::Integer => camera.integer_bounds(self.name).map(|(min, max)| (min as f64, max as f64)),
        }
        .map_err(|error| self.failed(error))
    }

    /// The unit that the device's description gives, such as `dB`.
    pub(super) fn unit(&self) -> Option<String> {
        let node = self.features.camera.device()?.feature(self.name)?;
        let unit = match self.kind {
            Kind::Float => node.dynamic_cast_ref::<GcFloat>()?.unit(),
            Kind::Integer => node.dynamic_cast_ref::<GcInteger>()?.unit(),
        }?;
        (!unit.is_empty()).then(|| told(&unit))
    }

    /// The values that the device takes in its present state, where it tells an increment.
    fn grid(&self) -> Result<Option<Grid>, CameraError> {
        let Some(increment) = self.increment else { return Ok(None) };
        let (min, max) = self.bounds()?;
        Ok(Some(Grid::new(min, max, increment)))
    }

    /// Refuses a value that lies beside the device's grid by more than `tolerance`. Some devices confirm any value and read it back, and
    /// apply the nearest one of the grid.
    pub(super) fn check_on_grid(&self, asked: f64, tolerance: f64) -> Result<(), CameraError> {
        let Some(grid) = self.grid()? else { return Ok(()) };
        grid.check(self.setting, asked, tolerance).map(|_| ())
    }

    /// The largest value that is not above `wanted` and that the device takes.
    pub(super) fn at_most(&self, wanted: f64) -> Result<f64, CameraError> {
        Ok(self.grid()?.map_or(wanted, |grid| grid.at_most(wanted)))
    }

    /// Writes a value that lies within the bounds, or beyond them by no more than what passes for rounding.
    pub(super) fn write(&self, asked: f64) -> Result<(), CameraError> {
        let (min, max) = self.bounds()?;
        if asked < min - self.tolerance || asked > max + self.tolerance {
            return Err(CameraError::Refused {
                setting: self.setting,
                asked: asked.to_string(),
                applied: format!("{min} to {max}"),
                remedy: "choose a value in this range".into(),
            });
        }
        // Not `clamp`, which does not take bounds that make no sense.
        let value = asked.max(min).min(max);
        let camera = self.features.camera;
        match self.kind {
            Kind::Float => camera.set_float(self.name, value),
            Kind::Integer => camera.set_integer(self.name, value.round() as i64),
        }
        .map_err(|error| self.failed(error))
    }

    /// Writes a value that has to be met exactly: it must lie within the bounds and on the device's grid.
    pub(super) fn write_exactly(&self, asked: u32) -> Result<(), CameraError> {
        let asked = f64::from(asked);
        let (min, max) = self.bounds()?;
        let step = self.increment.unwrap_or(1.0).max(1.0);
        let beyond_grid = (asked - min).rem_euclid(step);
        if asked < min || asked > max || beyond_grid != 0.0 {
            return Err(CameraError::Refused {
                setting: self.setting,
                asked: asked.to_string(),
                applied: format!("{min} to {max} in steps of {step}"),
                remedy: format!("choose one of these, such as {}", (asked - beyond_grid).max(min).min(max)),
            });
        }
        self.write(asked)
    }

    /// Reads the value back and refuses it where it differs from what was asked by more than what passes for rounding.
    pub(super) fn verify(&self, asked: f64) -> Result<f64, CameraError> {
        let applied = self.read()?;
        verify(self.setting, asked, applied, self.tolerance)?;
        Ok(applied)
    }

    /// Like [`Number::verify`], for a value that has to be met exactly.
    pub(super) fn verify_exactly(&self, asked: u32) -> Result<(), CameraError> {
        verify(self.setting, f64::from(asked), self.read()?, 0.0)
    }
}

/// What an error of the library means to the driver.
pub(super) fn failed(serial: &str, doing: &'static str, error: aravis::glib::Error) -> CameraError {
    let serial = serial.to_owned();
    match error.kind::<DeviceError>() {
        Some(DeviceError::NotConnected | DeviceError::NotFound) => {
            CameraError::Disconnected { serial, doing }
        }
        _ => CameraError::Device { serial, doing, cause: told(error.message()) },
    }
}
