//! The camera's features, by their SFNC names: one table, from which its registers and its GenICam description are made.

/// What a feature is, with its bounds.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    /// Whole numbers from the first to the second, in steps of the third.
    Integer(i64, Limit, i64),
    /// Real numbers from the first to the second, in a unit.
    Float(f64, f64, &'static str),
    /// Names and the numbers that stand for them.
    Enumeration(&'static [(&'static str, i64)]),
    /// 0 or 1.
    Boolean,
    /// Does something when 1 is written to it.
    Command,
    /// At most 63 bytes of text.
    Text,
}

/// The largest value of a feature.
#[derive(Debug, Clone, Copy)]
pub(super) enum Limit {
    Fixed(i64),
    /// What another feature says at the time.
    Feature(&'static str),
}

/// When a feature can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
    /// Only while no images are acquired.
    WriteIdle,
}

/// One feature.
#[derive(Debug)]
pub(super) struct Feature {
    pub(super) name: &'static str,
    pub(super) kind: Kind,
    pub(super) access: Access,
    /// After power-up and after loading the default user set; numbers of enumerations, 0 and 1 of booleans.
    pub(super) default: f64,
}

const SENSOR_WIDTH: i64 = 1920;
const SENSOR_HEIGHT: i64 = 1200;
const LARGEST: Limit = Limit::Fixed(i64::MAX);
const OFF: (&str, i64) = ("Off", 0);
const AUTO: Kind = Kind::Enumeration(&[OFF, ("Once", 1), ("Continuous", 2)]);

/// Numbers of pixel formats (PFNC 2.4).
const PIXEL_FORMATS: Kind = Kind::Enumeration(&[
    ("Mono8", 0x0108_0001),
    ("Mono10", 0x0110_0003),
    ("Mono12", 0x0110_0005),
    ("Mono16", 0x0110_0007),
]);
const MONO8: f64 = 0x0108_0001 as f64;

/// Every feature. What a careless program leaves behind differs from what a flight needs: a trigger, automatics.
pub(super) const FEATURES: &[Feature] = &[
    text("DeviceVendorName", Access::Read),
    text("DeviceModelName", Access::Read),
    text("DeviceSerialNumber", Access::Read),
    text("DeviceVersion", Access::Read),
    text("DeviceUserID", Access::Write),
    float("DeviceTemperature", Access::Read, -40.0, 125.0, "C", 41.5),
    command("TimestampLatch"),
    integer("TimestampLatchValue", Access::Read, 0, LARGEST, 1, 0),
    choice("UserSetSelector", Kind::Enumeration(&[("Default", 0), ("UserSet1", 1)]), Access::Write, 0.0),
    command("UserSetLoad"),
    command("UserSetSave"),
    integer("SensorWidth", Access::Read, 0, LARGEST, 1, SENSOR_WIDTH),
    integer("SensorHeight", Access::Read, 0, LARGEST, 1, SENSOR_HEIGHT),
    integer("WidthMax", Access::Read, 0, LARGEST, 1, SENSOR_WIDTH),
    integer("HeightMax", Access::Read, 0, LARGEST, 1, SENSOR_HEIGHT),
    integer("BinningHorizontal", Access::WriteIdle, 1, Limit::Fixed(2), 1, 1),
    integer("BinningVertical", Access::WriteIdle, 1, Limit::Fixed(2), 1, 1),
    integer("Width", Access::WriteIdle, 16, Limit::Feature("RegionWidthMax"), 16, SENSOR_WIDTH),
    integer("Height", Access::WriteIdle, 2, Limit::Feature("RegionHeightMax"), 2, SENSOR_HEIGHT),
    integer("OffsetX", Access::WriteIdle, 0, Limit::Feature("OffsetXMax"), 16, 0),
    integer("OffsetY", Access::WriteIdle, 0, Limit::Feature("OffsetYMax"), 2, 0),
    integer("RegionWidthMax", Access::Read, 0, LARGEST, 1, SENSOR_WIDTH),
    integer("RegionHeightMax", Access::Read, 0, LARGEST, 1, SENSOR_HEIGHT),
    integer("OffsetXMax", Access::Read, 0, LARGEST, 1, 0),
    integer("OffsetYMax", Access::Read, 0, LARGEST, 1, 0),
    choice("PixelFormat", PIXEL_FORMATS, Access::WriteIdle, MONO8),
    integer("PayloadSize", Access::Read, 0, LARGEST, 1, SENSOR_WIDTH * SENSOR_HEIGHT),
    choice(
        "AcquisitionMode",
        Kind::Enumeration(&[("SingleFrame", 1), ("Continuous", 0)]),
        Access::WriteIdle,
        0.0,
    ),
    command("AcquisitionStart"),
    command("AcquisitionStop"),
    choice("AcquisitionFrameRateEnable", Kind::Boolean, Access::Write, 0.0),
    float("AcquisitionFrameRate", Access::Write, 1.0, 500.0, "Hz", 30.0),
    float("ResultingFrameRate", Access::Read, 0.0, 1e6, "Hz", 0.0),
    choice("ExposureMode", Kind::Enumeration(&[("Timed", 1), ("TriggerWidth", 2)]), Access::Write, 2.0),
    choice("ExposureAuto", AUTO, Access::Write, 2.0),
    float("ExposureTime", Access::Write, 10.0, 1e6, "us", 5000.0),
    choice("GainSelector", Kind::Enumeration(&[("All", 0)]), Access::Write, 0.0),
    choice("GainAuto", AUTO, Access::Write, 2.0),
    float("Gain", Access::Write, 0.0, 24.0, "dB", 6.0),
    choice("TriggerSelector", Kind::Enumeration(&[("FrameStart", 0)]), Access::Write, 0.0),
    choice("TriggerMode", Kind::Enumeration(&[OFF, ("On", 1)]), Access::Write, 1.0),
    choice("ChunkModeActive", Kind::Boolean, Access::WriteIdle, 0.0),
];

const fn text(name: &'static str, access: Access) -> Feature {
    Feature { name, kind: Kind::Text, access, default: 0.0 }
}

const fn command(name: &'static str) -> Feature {
    Feature { name, kind: Kind::Command, access: Access::Write, default: 0.0 }
}

const fn choice(name: &'static str, kind: Kind, access: Access, default: f64) -> Feature {
    Feature { name, kind, access, default }
}

const fn integer(
    name: &'static str,
    access: Access,
    min: i64,
    max: Limit,
    step: i64,
    default: i64,
) -> Feature {
    Feature { name, kind: Kind::Integer(min, max, step), access, default: default as f64 }
}

const fn float(
    name: &'static str,
    access: Access,
    min: f64,
    max: f64,
    unit: &'static str,
    default: f64,
) -> Feature {
    Feature { name, kind: Kind::Float(min, max, unit), access, default }
}
