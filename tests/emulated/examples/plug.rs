//! Plugs an emulated camera into this machine, until a line comes on stdin or it ends: `plug usb3-vision`, `plug uvc`.

use std::process::ExitCode;

use uvcam_emulated::usb::{Device, Plugged};
use uvcam_emulated::{usb3_vision, uvc};

const SERIAL: &str = "EMULATED-1";

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("usb3-vision") => {
            plug(usb3_vision::Camera::new(usb3_vision::Identity::with_serial(SERIAL)));
        }
        Some("uvc") => plug(uvc::Camera::new(SERIAL)),
        _ => {
            eprintln!("usage: plug usb3-vision|uvc");
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}

fn plug(camera: impl Device) {
    let plugged = Plugged::new(camera);
    println!("plugged in, serial number {SERIAL}; a line on stdin pulls the plug");
    let _ = std::io::stdin().read_line(&mut String::new());
    plugged.unplug();
}
