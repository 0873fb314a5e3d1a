//! What every camera must do, whatever it is made of.
#![allow(clippy::unwrap_used)]

use uvcam::camera::source::{Simulated, Source};
use uvcam::camera::{CameraError, Settings};
use uvcam_emulated::gige_vision::{self, ADDRESS};
use uvcam_shm_ipc::PixelFormat;
use uvcam_tests::conformance::{Case, Kind, Started, settings};
use uvcam_tests::network::in_namespace;
use uvcam_tests::{SharedMemory, open, open_aravis, open_replay};

fn simulated(readout_us: f64) -> Source {
    Source::Simulated(Simulated { serial: "SIM".into(), still: false, readout_us, faults: vec![] })
}

mod simulated_camera {
    use super::*;

    fn run(case: Case) {
        let source = simulated(0.0);
        (case.run)(&Kind {
            open: &|| open(&source).unwrap(),
            settings: settings(160, 120),
            takes_gains_db: &[6.0],
            refuses_gains_db: &[1000.0],
        });
    }

    uvcam_tests::conformance!(run);
}

mod simulated_camera_mono12 {
    use super::*;

    fn run(case: Case) {
        let source = simulated(0.0);
        (case.run)(&Kind {
            open: &|| open(&source).unwrap(),
            settings: Settings { pixel_format: PixelFormat::Mono12, ..settings(160, 120) },
            takes_gains_db: &[6.0],
            refuses_gains_db: &[1000.0],
        });
    }

    uvcam_tests::conformance!(run);
}

mod replay_camera {
    use super::*;

    fn run(case: Case) {
        let folder = tempfile::tempdir().unwrap();
        for index in 0..3u8 {
            let picture = image::GrayImage::from_pixel(64, 48, image::Luma([100 + index]));
            picture.save(folder.path().join(format!("{index}.png"))).unwrap();
        }
        (case.run)(&Kind {
            open: &|| open_replay(folder.path()).unwrap(),
            settings: settings(64, 48),
            // A picture does not tell: what the configuration says is believed.
            takes_gains_db: &[6.0],
            refuses_gains_db: &[],
        });
    }

    uvcam_tests::conformance!(run);
}

mod gige_vision_camera {
    use super::*;

    fn run(case: Case) {
        in_namespace(case.name, || {
            let _program = gige_vision::Camera::start("GV1", 0);
            (case.run)(&Kind {
                open: &|| open_aravis(ADDRESS).unwrap(),
                // The program draws black below 10 ms.
                settings: Settings { exposure_us: 10_000.0, ..settings(512, 512) },
                // Its gain has no unit.
                takes_gains_db: &[],
                refuses_gains_db: &[3.0],
            });
        });
    }

    uvcam_tests::conformance!(run);
}

#[test]
fn replay_loops_over_the_pictures_in_the_order_of_their_names() {
    let folder = tempfile::tempdir().unwrap();
    for (name, level) in [("b.png", 20), ("a.png", 10), ("c.PNG", 30)] {
        let picture = image::GrayImage::from_pixel(8, 4, image::Luma([level]));
        picture.save_with_format(folder.path().join(name), image::ImageFormat::Png).unwrap();
    }
    let memory = SharedMemory::new();
    let mut camera = open_replay(folder.path()).unwrap();
    let mut started = Started::new(camera.as_mut(), &settings(8, 4), &memory);
    for expected in [10, 20, 30, 10, 20] {
        let mut capture = started.next_whole();
        assert!(capture.slot.pixels_mut().iter().all(|pixel| *pixel == expected));
        started.camera.queue(capture.slot).unwrap();
    }
}

#[test]
fn replay_refuses_an_empty_folder_and_pictures_of_another_size() {
    let folder = tempfile::tempdir().unwrap();
    let error = open_replay(folder.path()).unwrap_err();
    assert!(matches!(error, CameraError::Absent { .. }), "{error}");
    image::GrayImage::new(8, 4).save(folder.path().join("a.png")).unwrap();
    let error = open_replay(folder.path()).unwrap().configure(&settings(4, 8)).unwrap_err();
    assert!(error.is_refusal() && error.to_string().contains("8x4"), "{error}");
}

#[test]
fn a_simulated_frame_beyond_all_masks_is_refused_before_it_is_drawn() {
    let error = open(&simulated(0.0)).unwrap().configure(&settings(16384, 16384)).unwrap_err();
    assert!(
        error.is_refusal() && error.to_string().contains("width and height = 16384x16384 refused"),
        "{error}"
    );
}

#[test]
fn an_exposure_that_does_not_fit_is_refused_with_the_largest_that_does() {
    let asked = Settings { fps: 60.0, exposure_us: 7000.0, ..settings(64, 48) };
    let error = open(&simulated(10_000.0)).unwrap().configure(&asked).unwrap_err();
    assert!(error.is_refusal() && error.to_string().contains("is 6666"), "{error}");
    let fits = Settings { exposure_us: 6666.0, ..asked };
    assert!(open(&simulated(10_000.0)).unwrap().configure(&fits).is_ok());
}
