//! A USB3 Vision camera behind the kernel's USB, libusb and aravis as they are.

use uvcam_emulated::scene::picture;
use uvcam_emulated::usb::Plugged;
use uvcam_emulated::usb3_vision::{Camera, Identity};
use uvcam_masker::ImageView;
use uvcam_shm_ipc::Flags;
use uvcam_tests::conformance::{Case, Kind, settings};
use uvcam_tests::{Stage, next_frame, open_aravis, stderr};

mod copies;
mod faults;
mod replug;

const SIZE: (u32, u32) = (640, 480);
const BYTES: usize = (SIZE.0 * SIZE.1) as usize;

fn camera(name: &str, serial: &str) -> String {
    format!(
        "[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"aravis\", serial = \"{serial}\" }}\n\
         width = {}\nheight = {}\nfps = 60\nexposure_us = 1000\nmask = \"mask.png\"\n",
        SIZE.0, SIZE.1
    )
}

mod conforms {
    use super::*;

    fn run(case: Case) {
        let _device = Plugged::new(Camera::new(Identity::with_serial("U3V1")));
        (case.run)(&Kind {
            open: &|| open_aravis("U3V1").unwrap(),
            settings: settings(SIZE.0, SIZE.1),
            takes_gains_db: &[6.0],
            refuses_gains_db: &[1000.0],
        });
    }

    uvcam_tests::conformance!(run);
}

#[test]
fn six_hundred_masked_frames_and_none_lost() {
    let device = Plugged::new(Camera::new(Identity::with_serial("U3V1")));
    let stage = Stage::new(&camera("left", "U3V1"));
    let mask = stage.write_mask("mask.png", SIZE, 100);
    let mut subscriber = stage.subscriber("left");
    let driver = stage.driver();
    for _ in 0..600 {
        let frame = next_frame(&mut subscriber);
        let header = frame.header();
        assert!(header.flags.contains(Flags::MASKED) && header.mask_id == mask.id().0);
        let image = ImageView::new(frame.pixels(), SIZE.0, SIZE.1, header.stride as usize, 1).unwrap();
        assert_eq!(mask.masked_nonzero(&image).unwrap(), 0);
        let drawn = picture(header.device_frame_id, BYTES);
        let kept = BYTES - 100 * SIZE.0 as usize;
        assert!(frame.pixels()[..kept] == drawn[..kept], "pixels of frame {}", header.device_frame_id);
    }
    assert_eq!((subscriber.lost(), subscriber.epochs()), (0, 1));
    let camera = device.device();
    assert_eq!((camera.float("ExposureTime"), camera.float("Gain")), (1000.0, 0.0));
    drop(camera);
    let output = driver.stop();
    println!("{}", stderr(&output));
    assert!(output.status.success());
}

#[test]
fn an_exposure_beside_the_steps_that_the_camera_tells_is_refused() {
    let new = || Camera::with_exposure_steps(Identity::with_serial("U3V1"), 35.0);
    let device = Plugged::new(new());
    let configuration = camera("left", "U3V1");
    let output = stage_with(&configuration).driver().finish();
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    // Steps begin at the smallest, 10 us.
    let expected = "exposure_us = 1000 refused: the camera gives 10 to 1000000 in steps of 35; the nearest exposure_us are 990 and 1025";
    assert!(stderr(&output).contains(expected), "{}", stderr(&output));

    let stage = stage_with(&configuration.replace("exposure_us = 1000", "exposure_us = 1025"));
    let mut subscriber = stage.subscriber("left");
    let _driver = stage.driver();
    assert_eq!(next_frame(&mut subscriber).header().exposure_us, 1025.0);
    assert_eq!(device.device().float("ExposureTime"), 1025.0);
}

fn stage_with(configuration: &str) -> Stage {
    let stage = Stage::new(configuration);
    stage.write_mask("mask.png", SIZE, 100);
    stage
}
