//! Cameras on USB: who they are, their links, and the kernel's memory for their transfers.

use std::collections::BTreeMap;
use std::net::IpAddr;

use super::machine::Machine;
use super::{Finding, Severity};
use crate::camera::told;
use crate::config::{CameraConfig, Config, Source};

const DEVICES: &str = "/sys/bus/usb/devices";
const USBFS_MEMORY: &str = "/sys/module/usbcore/parameters/usbfs_memory_mb";

/// Vendors of cameras: Matrix Vision and Basler.
const VENDORS: [&str; 2] = ["164c", "2676"];
/// Class and subclass of a USB3 Vision interface: miscellaneous, USB3 Vision.
const USB3_VISION: (&str, &str) = ("ef", "05");
/// Link speed of SuperSpeed, the least that USB3 Vision is made for, Mbit/s.
const SUPER_SPEED: f64 = 5000.0;
/// Share of a link's bytes that frames can take; the rest goes to packet heads, acknowledgements and polling.
const USABLE: f64 = 0.8;
/// The least usbfs memory that is advised, MB.
const ADVISED_MB: u64 = 256;

/// A camera as sysfs describes it (kernel documentation, sysfs-bus-usb).
pub(super) struct UsbCamera {
    /// Its place, such as `2-1.4`.
    pub(super) place: String,
    /// Vendor id, four hexadecimal digits.
    pub(super) vendor: String,
    product: String,
    serial: Option<String>,
    /// Whether it has a USB3 Vision interface.
    pub(super) is_usb3_vision: bool,
    /// Mbit/s.
    speed: Option<f64>,
    bus: u32,
    device: u32,
}

impl UsbCamera {
    /// Whether a configuration means it by this serial or device id (`Vendor-Model-Serial`).
    pub(super) fn is(&self, wanted: &str) -> bool {
        let Some(serial) = &self.serial else { return false };
        wanted.strip_suffix(serial.as_str()).is_some_and(|before| before.is_empty() || before.ends_with('-'))
    }

    /// Whether it is an mvBlueFOX, which exposes and reads out in turn. The mvBlueFOX3 is another family.
    pub(super) fn is_mvbluefox(&self) -> bool {
        let family = self.product.strip_prefix("mvBlueFOX");
        self.vendor == VENDORS[0] && family.is_some_and(|rest| !rest.starts_with('3'))
    }

    /// The device node that the driver opens.
    pub(super) fn node(&self) -> String {
        format!("/dev/bus/usb/{:03}/{:03}", self.bus, self.device)
    }

    /// What messages call it.
    pub(super) fn describe(&self) -> String {
        let serial = self.serial.as_deref().unwrap_or("unknown");
        format!("camera {} serial {serial} at USB {}", self.product, self.place)
    }
}

/// The cameras on USB: devices of the known vendors, and every USB3 Vision device.
pub(super) fn cameras(machine: &Machine) -> Vec<UsbCamera> {
    let names = machine.names(DEVICES);
    let interface = |name: &str| {
        let read = |file: &str| machine.text(&format!("{DEVICES}/{name}/{file}")).unwrap_or_default();
        (read("bInterfaceClass"), read("bInterfaceSubClass"))
    };
    let devices = names.iter().filter(|name| !name.contains(':')).filter_map(|place| {
        let file = |file: &str| format!("{DEVICES}/{place}/{file}");
        let vendor = machine.text(&file("idVendor"))?;
        let interfaces = names
            .iter()
            .filter(|name| name.strip_prefix(place.as_str()).is_some_and(|rest| rest.starts_with(':')));
        let is_usb3_vision = interfaces
            .map(|name| interface(name))
            .any(|(class, subclass)| (class.as_str(), subclass.as_str()) == USB3_VISION);
        let camera = UsbCamera {
            place: place.clone(),
            product: machine.text(&file("product")).map(|text| told(&text)).unwrap_or_default(),
            serial: machine.text(&file("serial")).map(|text| told(&text)).filter(|serial| !serial.is_empty()),
            is_usb3_vision,
            speed: machine.value(&file("speed")),
            bus: machine.value(&file("busnum"))?,
            device: machine.value(&file("devnum"))?,
            vendor,
        };
        (is_usb3_vision || VENDORS.contains(&camera.vendor.as_str())).then_some(camera)
    });
    devices.collect()
}

/// The configured cameras that can be on USB; one named by its IP address cannot.
fn configured(config: &Config) -> impl Iterator<Item = (&CameraConfig, &str)> {
    config.cameras.iter().filter_map(|camera| match &camera.source {
        Source::Aravis { serial } if serial.parse::<IpAddr>().is_err() => Some((camera, serial.as_str())),
        _ => None,
    })
}

/// The configured cameras that are connected, with their device.
fn pairs<'a>(
    config: &'a Config,
    connected: &'a [UsbCamera],
) -> impl Iterator<Item = (&'a CameraConfig, &'a UsbCamera)> {
    configured(config)
        .filter_map(|(camera, serial)| Some((camera, connected.iter().find(|device| device.is(serial))?)))
}

/// Cameras on USB, their links, and what the system has for them.
pub(super) fn examine(machine: &Machine, config: &Config, cameras: &[UsbCamera]) -> Vec<Finding> {
    [
        connected(config, cameras),
        link(cameras),
        bandwidth(machine, config, cameras),
        memory(machine, config, cameras),
    ]
    .concat()
}

/// Whether each configured camera is connected. One that is not may be a GigE Vision camera, which sysfs does not know.
fn connected(config: &Config, connected: &[UsbCamera]) -> Vec<Finding> {
    let absent = configured(config).filter(|(_, serial)| !connected.iter().any(|device| device.is(serial)));
    let finding = |(camera, serial): (&CameraConfig, &str)| {
        Finding::new(
            Severity::Unknown,
            "connected",
            format!(
                "{}: no camera on USB has the serial {serial}, so its link and access were not examined",
                camera.name
            ),
            "uvcam list shows every camera that answers, GigE Vision included; check cable and power",
        )
    };
    absent.map(finding).collect()
}

/// Whether USB3 Vision cameras have the link that they were made for.
fn link(connected: &[UsbCamera]) -> Vec<Finding> {
    let slow = connected.iter().filter_map(|camera| {
        let speed = camera.speed.filter(|speed| camera.is_usb3_vision && *speed < SUPER_SPEED)?;
        Some(Finding::new(
            Severity::Fault,
            "usb_link",
            format!("{}: its link has {speed} Mbit/s, that of a USB 2 port or cable", camera.describe()),
            "plug it into a USB 3 port with a USB 3 cable, fully in; then see `lsusb --tree`",
        ))
    });
    slow.collect()
}

/// Whether the configured cameras of one bus fit it. All SuperSpeed ports of a controller are one bus.
fn bandwidth(machine: &Machine, config: &Config, connected: &[UsbCamera]) -> Vec<Finding> {
    let mut buses: BTreeMap<u32, (Vec<&str>, f64)> = BTreeMap::new();
    for (camera, device) in pairs(config, connected) {
        let (names, demand) = buses.entry(device.bus).or_default();
        names.push(&camera.name);
        *demand += camera.settings.frame_bytes() as f64 * camera.settings.fps / 1e6;
    }
    let overloaded = buses.into_iter().filter_map(|(bus, (names, demand))| {
        let speed: f64 = machine.value(&format!("{DEVICES}/usb{bus}/speed"))?;
        let usable = USABLE * carried_mb(speed)?;
        (demand > usable).then(|| {
            Finding::new(
                Severity::Fault,
                "usb_bandwidth",
                format!(
                    "{} send {demand:.0} MB/s over USB bus {bus}, whose controller carries about {usable:.0} MB/s",
                    names.join(", ")
                ),
                "plug one of them into a port of another controller (`lsusb --tree` shows them), or lower fps or region",
            )
        })
    });
    overloaded.collect()
}

/// Bytes that a link of `speed` Mbit/s carries after its coding, MB/s. USB 2.0 (5.8.4): 13 packets of 512 bytes a microframe;
/// USB 3.2: 8 of 10 bits at 5 Gbit/s, 128 of 132 above.
fn carried_mb(speed: f64) -> Option<f64> {
    match speed {
        480.0 => Some(53.2),
        SUPER_SPEED => Some(500.0),
        10_000.0.. => Some(speed / 8.0 * 128.0 / 132.0),
        _ => None,
    }
}

/// Whether the kernel's memory for USB transfers, which all programs share, holds what the configured cameras can queue.
/// With room for less than one frame of each camera, frames do not arrive whole.
fn memory(machine: &Machine, config: &Config, connected: &[UsbCamera]) -> Vec<Finding> {
    // 0 is no limit.
    let limit = machine.value::<u32>(USBFS_MEMORY).filter(|mb| *mb > 0).map(u64::from);
    let frames: u64 = pairs(config, connected).map(|(camera, _)| camera.settings.frame_bytes() as u64).sum();
    let queued = frames.saturating_mul(config.ipc.slots as u64);
    let Some(mb) = limit.filter(|mb| mb << 20 < queued) else { return Vec::new() };
    let needed = queued.div_ceil(1 << 20);
    vec![Finding::new(
        if mb << 20 < frames { Severity::Fault } else { Severity::Warning },
        "usbfs_memory",
        format!(
            "the kernel has {mb} MB for USB transfers, the slots of the connected cameras are {needed} MB"
        ),
        format!("echo {} | sudo tee {USBFS_MEMORY}", needed.max(ADVISED_MB)),
    )]
}
