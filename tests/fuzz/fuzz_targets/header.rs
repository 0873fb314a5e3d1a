//! Headers of frames and records of health, as a consumer finds them in shared memory that somebody else wrote.
#![no_main]
#![allow(clippy::unwrap_used)]

use libfuzzer_sys::fuzz_target;
use uvcam_fuzz::health;
// The consumer's own count of losses and its prediction of the next frame are no part of its interface.
// rustfmt would look for the files of their tests here.
use uvcam_shm_ipc as header;

#[allow(dead_code)]
#[rustfmt::skip]
#[path = "../../../shm_ipc/src/continuity.rs"]
mod continuity;
#[allow(dead_code)]
#[rustfmt::skip]
#[path = "../../../shm_ipc/src/prediction.rs"]
mod prediction;

use continuity::Continuity;
use prediction::Prediction;

fuzz_target!(|bytes: &[u8]| {
    let (mut continuity, mut prediction) = (Continuity::default(), Prediction::default());
    let mut rest = bytes;
    while let Some((header, payload_len)) = uvcam_fuzz::header(&mut rest) {
        match header.validate(payload_len) {
            Ok(image_bytes) => {
                let row = header.width as usize * header.pixel_format().unwrap().bytes_per_pixel();
                assert_eq!(image_bytes, header.stride as usize * (header.height as usize - 1) + row);
                assert!(row <= header.stride as usize && image_bytes <= payload_len);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        // Whatever the check lets through now or one day.
        continuity.step(&header);
        prediction.frame(&header);
        if let Some(watch) = prediction.next(header.arrival_monotonic_ns) {
            assert!(watch.budget_ns <= 1_000_000, "watches for {} ns", watch.budget_ns);
            prediction.overslept(watch.wake_ns, header.device_timestamp_ns);
            prediction.watched(header.device_frame_id);
        }
    }
    if let Some(health) = health(bytes) {
        if let Err(error) = health.validate() {
            assert!(!error.to_string().is_empty());
        }
        assert!(health.last_error().len() <= 3 * health.last_error.len());
        assert!(health.temperature_c().is_none_or(f64::is_finite));
    }
});
