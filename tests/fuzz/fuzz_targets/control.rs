//! A request to a running driver, and what it sets going; a reply, as a command reads it.
#![no_main]
#![allow(clippy::unwrap_used)]

use libfuzzer_sys::fuzz_target;
use uvcam::camera::Settings;
use uvcam::config::Generate;
use uvcam::generate::{Generator, Request};
use uvcam_fuzz::message;
use uvcam_masker::GrayImage;
use uvcam_shm_ipc::control::{self, GenerateRequest, Reply, Verdict};

/// Size of the lit frames.
const SIZE: (u32, u32) = (24, 16);

fuzz_target!(|bytes: &[u8]| {
    // As it arrives from shared memory.
    let text = String::from_utf8_lossy(bytes);
    if let Ok(reply) = text.parse::<Reply>() {
        assert_eq!(reply.to_text().parse::<Reply>().unwrap(), reply);
    }
    match text.parse() {
        Ok(request) => {
            let request: control::Request = request;
            assert_eq!(request.to_text().parse::<control::Request>().unwrap(), request);
            if let control::Request::Generate(request) = request {
                fulfil(&request);
            }
        }
        Err(error) => drop(message(&error)),
    }
});

/// What the driver does with a request: it refuses it, or asks a camera for its light, and makes the mask of the frames that come.
fn fulfil(request: &GenerateRequest) {
    let request = match Request::try_from((request, &Generate::default())) {
        Ok(request) => request,
        Err(error) => {
            message(&error);
            return;
        }
    };
    let lit_settings = request.settings(&flight());
    assert!(lit_settings.fps > 0.0 && lit_settings.exposure_us * lit_settings.fps <= 1e6);
    let mut generator = Generator::new(request);
    for frame in 0..3 {
        if generator.is_satisfied() {
            break;
        }
        if let Err(error) = generator.add(lit(frame)) {
            message(&error);
            return;
        }
    }
    match generator.finish(Some(lit_settings.exposure_us)) {
        Ok(generated) => {
            let report = generated.report();
            assert_eq!(report.verdict == Verdict::Ok, generated.outcome.mask.is_some());
            generated.provenance();
        }
        Err(error) => drop(message(&error)),
    }
}

/// A lamp that moves over an airframe of two bars.
fn lit(frame: u32) -> GrayImage {
    let (width, height) = SIZE;
    GrayImage::from_fn(width, height, |x, y| {
        let airframe = x < 6 || y > 12;
        let lamp = (x + y) / 14 == frame;
        image::Luma([if airframe && lamp { 250 } else { 5 }])
    })
}

fn flight() -> Settings {
    let (width, height) = SIZE;
    Settings::new(width, height, 60.0, 1000.0)
}
