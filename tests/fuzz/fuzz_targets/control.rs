//! A request to a running driver, and what it sets going; a reply, as a command reads it.
#![no_main]
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use libfuzzer_sys::fuzz_target;
use uvcam::camera::Settings;
use uvcam::config::Generate;
use uvcam::control::{Reply, Request};
use uvcam::generate::Order;
use uvcam::generator::{Generator, Wish};
use uvcam_fuzz::message;
use uvcam_masker::GrayImage;
use uvcam_shm_ipc::PixelFormat;

/// Size of the lit frames.
const SIZE: (u32, u32) = (24, 16);

fuzz_target!(|bytes: &[u8]| {
    // As it arrives from shared memory.
    let text = String::from_utf8_lossy(bytes);
    if let Ok(reply) = serde_json::from_str::<Reply>(&text) {
        assert_eq!(again(&reply), again(&serde_json::from_str::<Reply>(&again(&reply)).unwrap()));
    }
    match serde_json::from_str::<Request>(&text) {
        Ok(request) => {
            assert_eq!(again(&request), again(&serde_json::from_str::<Request>(&again(&request)).unwrap()));
            if let Request::Generate { wish, .. } = request {
                grant(wish);
            }
        }
        Err(error) => drop(message(&error)),
    }
});

fn again(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap()
}

/// What the driver does with a wish: it orders lit frames, and makes the mask of those that come.
fn grant(wish: Wish) {
    let configured = Generate::default();
    let order = Order {
        exposure_us: wish.exposure_us.unwrap_or(configured.exposure_us),
        gain_db: wish.gain_db.unwrap_or(configured.gain_db),
        generator: Generator::new(wish, &configured),
        progress: Box::new(|_| {}),
        cancelled: Arc::default(),
        done: Box::new(|_, _| {}),
    };
    let _ = order.settings(&flight());
    let mut generator = order.generator;
    for frame in 0..3 {
        if generator.is_satisfied() {
            break;
        }
        if let Err(error) = generator.add(lit(frame)) {
            message(&error);
            return;
        }
    }
    match generator.finish(Some(order.exposure_us)) {
        Ok(generated) => {
            let report = generated.report();
            assert_eq!(report.is_ok(), generated.outcome.mask.is_some());
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
    Settings {
        width,
        height,
        offset_x: 0,
        offset_y: 0,
        binning_horizontal: 1,
        binning_vertical: 1,
        pixel_format: PixelFormat::Mono8,
        fps: 60.0,
        exposure_us: 1000.0,
        gain_db: 0.0,
    }
}
