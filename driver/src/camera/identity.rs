//! Who a device says it is.

use std::fmt;

/// The most characters of a device's text that are kept: the longest of USB has 126.
const LONGEST: usize = 256;

/// Who a device says it is.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Identity {
    /// The `kind` that a configuration names: `aravis`, `simulated`, `replay`, `v4l2`.
    pub kind: &'static str,
    /// Manufacturer (SFNC `DeviceVendorName`).
    pub vendor: String,
    /// Model (SFNC `DeviceModelName`).
    pub model: String,
    /// Serial number (SFNC `DeviceSerialNumber`), by which a configuration finds the device.
    pub serial: String,
    /// How it is connected: `USB3Vision`, `GigEVision`, `none`, ...
    pub transport: String,
    /// Where it is connected: an IP address, a device node, a folder.
    pub address: String,
}

impl Identity {
    /// Whether both are one device, wherever it is connected. Cheap cameras share serials, so that model and vendor count as well.
    pub fn is_same_device(&self, other: &Identity) -> bool {
        (&self.serial, &self.model, &self.vendor) == (&other.serial, &other.model, &other.vendor)
    }
}

/// Model and serial.
impl fmt::Display for Identity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} \"{}\"", self.model, self.serial)
    }
}

/// A device's text as logs and comparisons take it: without white space around it, without characters that would control a terminal, and
/// not longer than a line.
pub fn told(text: &str) -> String {
    let printable =
        |character: char| if character.is_control() { char::REPLACEMENT_CHARACTER } else { character };
    text.trim().chars().take(LONGEST).map(printable).collect()
}

/// What a search found, in a line that is the same whatever the order in which it was found, and does not grow with a network.
pub fn listed(mut found: Vec<String>) -> String {
    const MOST: usize = 16;
    found.sort_unstable();
    let others = found.len().saturating_sub(MOST);
    found.truncate(MOST);
    let found = found.join(", ");
    if others == 0 { found } else { format!("{found} and {others} more") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(model: &str, serial: &str, address: &str) -> Identity {
        let text = |text: &str| text.to_owned();
        Identity {
            kind: "v4l2",
            vendor: text("Maker"),
            model: text(model),
            serial: text(serial),
            transport: text("USB"),
            address: text(address),
        }
    }

    #[test]
    fn a_device_is_the_same_wherever_it_is_connected() {
        let camera = identity("M1", "7", "/dev/video0");
        assert!(camera.is_same_device(&identity("M1", "7", "/dev/video2")));
        assert!(!camera.is_same_device(&identity("M1", "8", "/dev/video0")));
        assert!(!camera.is_same_device(&identity("M2", "7", "/dev/video0")), "a serial that everyone has");
    }

    #[test]
    fn a_devices_text_controls_no_terminal() {
        assert_eq!(told(" 25003774\0\n"), "25003774\u{fffd}");
        assert_eq!(told("\u{1b}[2Jcam\r\nera\t"), "\u{fffd}[2Jcam\u{fffd}\u{fffd}era");
        assert_eq!(told("Kamera für Fluggerät"), "Kamera für Fluggerät");
        assert_eq!(told(&"9".repeat(1 << 20)).len(), LONGEST);
    }

    #[test]
    fn a_list_has_one_order_and_an_end() {
        let list = |names: &[&str]| listed(names.iter().map(|name| (*name).to_owned()).collect());
        assert_eq!(list(&["b", "a"]), list(&["a", "b"]));
        let many: Vec<String> = (10..40).map(|number| number.to_string()).collect();
        let text = listed(many);
        assert!(text.starts_with("10, 11") && text.ends_with("25 and 14 more"), "{text}");
    }
}
