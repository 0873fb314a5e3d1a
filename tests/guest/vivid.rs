//! The kernel's virtual video device.

use std::fs;

#[test]
fn vivid_is_there() {
    for device in ["video0", "video1"] {
        let name = fs::read_to_string(format!("/sys/class/video4linux/{device}/name")).unwrap();
        assert!(name.starts_with("vivid"), "{device} is {name}");
        assert!(fs::metadata(format!("/dev/{device}")).is_ok());
    }
}
