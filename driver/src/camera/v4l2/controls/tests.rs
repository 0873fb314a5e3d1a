//! The controls of a device that is a table.

use std::cell::RefCell;
use std::collections::BTreeMap;

use super::*;
use crate::camera::source::V4l2Device;

/// A control's values, and how the device deviates from what it is asked.
#[derive(Clone, Copy)]
struct Entry {
    range: Range,
    value: i64,
    /// It takes a value and keeps another one.
    stubborn: bool,
    /// It stalls while the exposure is fixed.
    locked_while_manual: bool,
}

#[derive(Default)]
struct Table(RefCell<BTreeMap<u32, Entry>>);

const MANUAL: i64 = v4l2_exposure_auto_type_V4L2_EXPOSURE_MANUAL as i64;

impl Table {
    fn with(self, id: u32, (minimum, maximum, step): (i64, i64, i64), value: i64) -> Self {
        let range = Range { minimum, maximum, step };
        self.0.borrow_mut().insert(id, Entry { range, value, stubborn: false, locked_while_manual: false });
        self
    }

    fn stubborn(self, id: u32) -> Self {
        self.0.borrow_mut().get_mut(&id).unwrap().stubborn = true;
        self
    }

    fn locked_while_manual(self, id: u32) -> Self {
        self.0.borrow_mut().get_mut(&id).unwrap().locked_while_manual = true;
        self
    }

    fn value(&self, id: u32) -> i64 {
        self.0.borrow()[&id].value
    }
}

impl Controls for Table {
    fn range(&self, id: u32) -> io::Result<Option<Range>> {
        Ok(self.0.borrow().get(&id).map(|entry| entry.range))
    }

    fn read(&self, id: u32) -> io::Result<i64> {
        self.0.borrow().get(&id).map(|entry| entry.value).ok_or_else(|| Errno::INVAL.into())
    }

    fn write(&self, id: u32, value: i64) -> io::Result<()> {
        let mut table = self.0.borrow_mut();
        let is_manual = table.get(&V4L2_CID_EXPOSURE_AUTO).is_some_and(|mode| mode.value == MANUAL);
        let entry = table.get_mut(&id).ok_or(Errno::INVAL)?;
        if !entry.range.contains(value) {
            return Err(Errno::RANGE.into());
        }
        if entry.locked_while_manual && is_manual {
            return Err(Errno::PIPE.into());
        }
        if !entry.stubborn {
            entry.value = value;
        }
        Ok(())
    }
}

fn settings(exposure_us: f64, gain_db: f64) -> Settings {
    Settings { gain_db, ..Settings::new(8, 4, 50.0, exposure_us) }
}

fn source(gain_step_db: Option<f64>, fixed_exposure_us: Option<f64>) -> V4l2 {
    V4l2 { device: V4l2Device::Serial("1".into()), memory: None, gain_step_db, fixed_exposure_us }
}

fn refusal<T>(outcome: Result<T, Failure>) -> String {
    match outcome {
        Err(Failure::Refused(error)) => error.to_string(),
        Err(Failure::Io(error)) => panic!("no refusal: {error}"),
        Ok(_) => panic!("no refusal"),
    }
}

fn fine<T>(outcome: Result<T, Failure>) -> T {
    match outcome {
        Ok(value) => value,
        Err(Failure::Refused(error)) => panic!("{error}"),
        Err(Failure::Io(error)) => panic!("{error}"),
    }
}

const EXPOSURE: u32 = V4L2_CID_EXPOSURE_ABSOLUTE;

#[test]
fn what_the_device_has_is_switched_off() {
    let table = Table::default()
        .with(V4L2_CID_EXPOSURE_AUTO, (0, 3, 1), 3)
        .with(V4L2_CID_EXPOSURE_AUTO_PRIORITY, (0, 1, 1), 1)
        .with(V4L2_CID_AUTOGAIN, (0, 1, 1), 1)
        .with(V4L2_CID_AUTO_WHITE_BALANCE, (0, 1, 1), 1)
        .with(V4L2_CID_POWER_LINE_FREQUENCY, (0, 2, 1), 1);
    fine(automatics_off(&table));
    assert_eq!(table.value(V4L2_CID_EXPOSURE_AUTO), 1, "V4L2_EXPOSURE_MANUAL");
    for id in [
        V4L2_CID_EXPOSURE_AUTO_PRIORITY,
        V4L2_CID_AUTOGAIN,
        V4L2_CID_AUTO_WHITE_BALANCE,
        V4L2_CID_POWER_LINE_FREQUENCY,
    ] {
        assert_eq!(table.value(id), 0);
    }
}

#[test]
fn an_automatic_that_stays_on_is_refused() {
    let table = Table::default().with(V4L2_CID_AUTOGAIN, (0, 1, 1), 1).stubborn(V4L2_CID_AUTOGAIN);
    assert!(refusal(automatics_off(&table)).contains("gain_automatic = 0 refused: the camera gives 1"));
}

#[test]
fn a_mains_frequency_that_cannot_be_switched_off_is_left() {
    let table = Table::default().with(V4L2_CID_POWER_LINE_FREQUENCY, (1, 2, 1), 2);
    fine(automatics_off(&table));
    assert_eq!(table.value(V4L2_CID_POWER_LINE_FREQUENCY), 2);
}

#[test]
fn the_frame_rate_comes_before_the_fixed_exposure_that_locks_it() {
    let device = |mode| {
        Table::default()
            .with(V4L2_CID_EXPOSURE_AUTO, (0, 3, 1), mode)
            .with(V4L2_CID_EXPOSURE_AUTO_PRIORITY, (0, 1, 1), 1)
            .locked_while_manual(V4L2_CID_EXPOSURE_AUTO_PRIORITY)
    };
    let automatic = device(3);
    fine(automatics_off(&automatic));
    assert_eq!(automatic.value(V4L2_CID_EXPOSURE_AUTO_PRIORITY), 0);
    assert_eq!(automatic.value(V4L2_CID_EXPOSURE_AUTO), MANUAL);

    // Left behind by another program: it cannot be changed any more, and changes nothing.
    let manual = device(MANUAL);
    fine(automatics_off(&manual));
    assert_eq!(manual.value(V4L2_CID_EXPOSURE_AUTO_PRIORITY), 1);
}

#[test]
fn a_constant_takes_the_least_that_it_knows() {
    for (range, least) in
        [((0, 2, 1), 0), ((1, 5, 1), 1), ((-4, 4, 1), 0), ((-10, -1, 1), -1), ((3, 1, 1), 1)]
    {
        let table = Table::default().with(V4L2_CID_BACKLIGHT_COMPENSATION, range, 2);
        fine(automatics_off(&table));
        let kept = table.value(V4L2_CID_BACKLIGHT_COMPENSATION);
        assert!(kept == least || range.0 > range.1, "{kept} of {range:?}");
    }
    let id = V4L2_CID_BACKLIGHT_COMPENSATION;
    let stubborn = Table::default().with(id, (0, 2, 1), 2).stubborn(id);
    fine(automatics_off(&stubborn));
}

#[test]
fn exposure_is_set_in_units_of_100_us() {
    let table = Table::default().with(EXPOSURE, (1, 10_000, 1), 157);
    for (asked, value, applied) in [(1000.0, 10, 1000.0), (1009.0, 10, 1000.0), (99.0, 1, 100.0)] {
        let settings = settings(asked, 0.0);
        fine(write_exposure(&table, &settings, &source(None, None)));
        assert_eq!(table.value(EXPOSURE), value);
        assert_eq!(fine(read_exposure(&table, &settings, &source(None, None))), applied);
    }
}

#[test]
fn an_exposure_between_two_steps_is_refused_with_both() {
    let table = Table::default().with(EXPOSURE, (1, 10_000, 1), 157);
    let refused = |us| refusal(write_exposure(&table, &settings(us, 0.0), &source(None, None)));
    for asked in [149.0, 150.0, 151.0] {
        let message = refused(asked);
        assert!(message.contains("the nearest exposure_us are 100 and 200"), "{message}");
    }
    assert!(refused(1049.0).contains("the nearest exposure_us are 1000 and 1100"));
    assert!(refused(50.0).contains("the nearest exposure_us is 100"));
    assert_eq!(table.value(EXPOSURE), 157, "nothing was written");
}

#[test]
fn exposure_follows_the_steps_of_the_device() {
    let table = Table::default().with(EXPOSURE, (3, 2047, 4), 3);
    let message = refusal(write_exposure(&table, &settings(1000.0, 0.0), &source(None, None)));
    assert!(message.contains("the nearest exposure_us are 700 and 1100"), "{message}");
    fine(write_exposure(&table, &settings(1100.0, 0.0), &source(None, None)));
    assert_eq!(table.value(EXPOSURE), 11);
}

#[test]
fn an_exposure_out_of_reach_is_refused_with_the_nearest() {
    let table = Table::default().with(EXPOSURE, (5, 100, 1), 5);
    let refused = |us| refusal(write_exposure(&table, &settings(us, 0.0), &source(None, None)));
    assert!(refused(20_000.0).contains("500 to 10000 in steps of 100; the nearest exposure_us is 10000"));
    assert!(refused(100.0).contains("the nearest exposure_us is 500"));
    assert_eq!(table.value(EXPOSURE), 5, "nothing was written");
}

#[test]
fn an_exposure_that_reads_back_otherwise_is_refused() {
    let table = Table::default().with(EXPOSURE, (1, 10_000, 1), 157).stubborn(EXPOSURE);
    let message = refusal(write_exposure(&table, &settings(1000.0, 0.0), &source(None, None)));
    assert!(message.contains("exposure_time_absolute = 10 refused: the camera gives 157"), "{message}");
    let message = refusal(read_exposure(&table, &settings(1000.0, 0.0), &source(None, None)));
    assert!(message.contains("exposure_us = 1000 refused: the camera gives 15700"), "{message}");
}

#[test]
fn a_device_without_the_control_has_the_exposure_that_is_stated() {
    let (table, flight) = (Table::default(), settings(1000.0, 0.0));
    let message = refusal(write_exposure(&table, &flight, &source(None, None)));
    assert!(message.contains("fixed_exposure_us"), "{message}");
    let fixed = source(None, Some(1000.0));
    fine(write_exposure(&table, &flight, &fixed));
    assert_eq!(fine(read_exposure(&table, &flight, &fixed)), 1000.0);
    let message = refusal(write_exposure(&table, &settings(5000.0, 0.0), &fixed));
    assert!(message.contains("exposure_us = 5000 refused: the camera gives 1000"), "{message}");
}

#[test]
fn no_gain_is_the_lowest() {
    let (settings, source) = (settings(1000.0, 0.0), source(None, None));
    let table = Table::default().with(V4L2_CID_GAIN, (16, 255, 1), 100);
    fine(write_gain(&table, &settings, &source));
    assert_eq!(table.value(V4L2_CID_GAIN), 16);
    assert_eq!(fine(read_gain(&table, &settings, &source)), 0.0);
    fine(write_gain(&Table::default(), &settings, &source));
    assert_eq!(fine(read_gain(&Table::default(), &settings, &source)), 0.0);
}

#[test]
fn a_gain_changed_behind_the_back_is_refused() {
    let table = Table::default().with(V4L2_CID_GAIN, (16, 255, 1), 17);
    assert!(refusal(read_gain(&table, &settings(1000.0, 0.0), &source(None, None))).contains("gain_db"));
}

#[test]
fn gain_in_decibels_needs_their_step() {
    let table = Table::default().with(V4L2_CID_ANALOGUE_GAIN, (10, 250, 1), 10);
    let settings = settings(1000.0, 6.0);
    let message = refusal(write_gain(&table, &settings, &source(None, None)));
    assert!(message.contains("10 to 250 in a unit that it does not tell; set gain_db = 0"), "{message}");

    let with_step = source(Some(0.3), None);
    fine(write_gain(&table, &settings, &with_step));
    assert_eq!(table.value(V4L2_CID_ANALOGUE_GAIN), 30);
    assert!((fine(read_gain(&table, &settings, &with_step)) - 6.0).abs() < 1e-9);
    assert!(
        refusal(write_gain(&table, &Settings { gain_db: 73.0, ..settings.clone() }, &with_step))
            .contains("0 to 72")
    );
    assert!(
        refusal(write_gain(&table, &Settings { gain_db: -1.0, ..settings.clone() }, &with_step))
            .contains("nearest gain_db is 0")
    );
    let message = refusal(write_gain(&Table::default(), &settings, &with_step));
    assert!(message.contains("no control of it"), "{message}");
}

#[test]
fn a_gain_between_two_steps_is_refused_with_both() {
    let table = Table::default().with(V4L2_CID_GAIN, (0, 16, 2), 0);
    let coarse = source(Some(3.0), None);
    let message = refusal(write_gain(&table, &settings(1000.0, 4.0), &coarse));
    assert!(message.contains("0 to 48 in steps of 6; the nearest gain_db are 0 and 6"), "{message}");
    fine(write_gain(&table, &settings(1000.0, 6.0), &coarse));
    assert_eq!(table.value(V4L2_CID_GAIN), 2);
}

#[test]
fn ranges_that_make_no_sense_stop_nothing() {
    for range in [(i64::MIN, i64::MAX, 1), (i64::MAX, i64::MIN, i64::MAX), (5, 1, 1)] {
        let table = Table::default().with(EXPOSURE, range, 1).with(V4L2_CID_GAIN, range, i64::MIN).with(
            V4L2_CID_BACKLIGHT_COMPENSATION,
            range,
            1,
        );
        let (settings, source) = (settings(1000.0, 6.0), source(Some(0.1), None));
        let _ = (automatics_off(&table), write_exposure(&table, &settings, &source));
        let _ = (write_gain(&table, &settings, &source), read_gain(&table, &settings, &source));
    }
}
