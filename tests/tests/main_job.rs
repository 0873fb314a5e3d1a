//! The main job, on a camera that is not ours: a GigE Vision device, through aravis, masked, into another process.
#![allow(clippy::unwrap_used)]

use std::collections::HashMap;

use uvcam_emulated::gige_vision;
use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::{Flags, Frame};
use uvcam_tests::network::in_namespace;
use uvcam_tests::{Stage, next_frame, stderr};

const SIZE: (u32, u32) = (640, 480);
const FRAMES: usize = 500;

fn camera(mask: &str) -> String {
    format!(
        "[[camera]]\nname = \"left\"\nsource = {{ kind = \"aravis\", serial = \"GV01\" }}\n\
         width = {}\nheight = {}\nfps = 25\nexposure_us = 10000\nmask = \"{mask}\"\n",
        SIZE.0, SIZE.1
    )
}

/// Runs the driver on a camera that was just switched on, and hands over every frame.
fn run(mask: &str, frames: usize, mut look: impl FnMut(&Frame)) {
    let _device = gige_vision::Camera::start("GV01", 0);
    let stage = Stage::new(&camera(mask));
    half_mask().save(&stage.file("mask.png"), &[]).unwrap();
    // Open before the driver starts, so that the first frame is seen as well.
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    for _ in 0..frames {
        look(&next_frame(&mut subscriber));
    }
    assert_eq!(subscriber.lost(), 0);
    assert_eq!(subscriber.epochs(), 1);
    let output = driver.stop();
    assert!(output.status.success(), "{}", stderr(&output));
}

fn half_mask() -> Mask {
    Mask::from_fn(SIZE.0, SIZE.1, |x, y| (x / 20 + y / 20) % 2 == 0)
}

#[test]
fn five_hundred_masked_frames_reach_another_process() {
    in_namespace("five_hundred_masked_frames_reach_another_process", || {
        // The device draws the same picture for the same frame id: the scene stands still from run to run.
        let mut unmasked: HashMap<u64, Vec<u8>> = HashMap::new();
        run("none", FRAMES, |frame| {
            assert!(!frame.header().flags.contains(Flags::MASKED));
            unmasked.insert(frame.header().device_frame_id, frame.pixels().to_vec());
        });

        let mask = half_mask();
        // Told once: a consumer that looks every pixel up in the mask would not keep up with the camera on a busy machine.
        let kept: Vec<u8> = (0..SIZE.0 * SIZE.1)
            .map(|at| if mask.is_masked(at % SIZE.0, at / SIZE.0) { 0 } else { 255 })
            .collect();
        // Frames are counted from the first whole one on, which need not be the device's first: nobody was promised that one.
        let (mut compared, mut last, mut ahead) = (0, None, None::<i64>);
        run("mask.png", FRAMES, |frame| {
            let header = frame.header();
            assert!(header.flags.contains(Flags::MASKED) && header.mask_id == mask.id().0);
            let image = ImageView::new(frame.pixels(), SIZE.0, SIZE.1, header.stride as usize, 1).unwrap();
            assert_eq!(mask.masked_nonzero(&image).unwrap(), 0);

            let stamps =
                (header.arrival_monotonic_ns, header.mid_exposure_realtime_ns, header.send_monotonic_ns);
            if let Some((arrival, mid_exposure, send)) = last.replace(stamps) {
                assert!(stamps.0 > arrival && stamps.1 > mid_exposure && stamps.2 > send);
            }
            let changed = |before: &[u8]| {
                let pixels = before.iter().zip(frame.pixels()).zip(&kept);
                pixels.into_iter().position(|((before, after), kept)| (before ^ after) & kept != 0)
            };
            if ahead.is_none() {
                let same = (0..4).find(|number| changed(&unmasked[number]).is_none());
                ahead = same.map(|number: u64| number as i64 - header.device_frame_id as i64);
            }
            let Some(ahead) = ahead else { return };
            let number = header.device_frame_id.checked_add_signed(ahead);
            if let Some(before) = number.and_then(|number| unmasked.get(&number)) {
                compared += 1;
                assert_eq!(
                    changed(before),
                    None,
                    "a pixel outside the mask, frame {}",
                    header.device_frame_id
                );
            }
        });
        assert!(compared > FRAMES / 2, "only {compared} frames could be compared");
    });
}
