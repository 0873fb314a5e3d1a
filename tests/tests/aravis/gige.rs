//! A GigE Vision camera in another process, over loopback.

use std::time::Duration;

use uvcam::camera::kinds::{self, list};
use uvcam::camera::source::Source;
use uvcam::camera::{CameraError, Capture, Event, Settings};
use uvcam::realtime::Realtime;

use uvcam_emulated::gige_vision::{self, ADDRESS};
use uvcam_tests::network::{in_namespace, in_namespace_without_net_raw};
use uvcam_tests::open_aravis;

use crate::{PATIENCE, SETTINGS, SLOTS, is_ramp, ready, whole};

#[test]
fn five_hundred_frames_without_a_loss() {
    in_namespace("gige::five_hundred_frames_without_a_loss", || {
        let _program = gige_vision::Camera::start("GV500", 0);
        let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
        camera.start().unwrap();
        let mut last: Option<(u64, u64, u64)> = None;
        for _ in 0..500 {
            let mut capture = whole(camera.as_mut());
            assert!(is_ramp(capture.slot.pixels_mut(), 640));
            let device_ns = capture.device_timestamp_ns.expect("it has a clock");
            if let Some((frame_id, last_device_ns, arrival_ns)) = last {
                assert_eq!(capture.frame_id, frame_id + 1);
                assert!(device_ns > last_device_ns);
                assert!(capture.arrival_monotonic_ns > arrival_ns);
            }
            last = Some((capture.frame_id, device_ns, capture.arrival_monotonic_ns));
            camera.queue(capture.slot).unwrap();
        }
    });
}

#[test]
fn the_thread_that_completes_frames_is_scheduled_as_the_one_that_opened_the_camera() {
    in_namespace(
        "gige::the_thread_that_completes_frames_is_scheduled_as_the_one_that_opened_the_camera",
        || {
            let _program = gige_vision::Camera::start("GV7", 0);
            // Cores need no rights, priorities do; both are inherited in the same way.
            Realtime { priority: 0, cpus: vec![0] }.apply("GV7");
            let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
            camera.start().unwrap();
            whole(camera.as_mut());
            let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
            let stream = tasks
                .map(|task| std::fs::read_to_string(task.path().join("status")).unwrap())
                .find(|status| status.starts_with("Name:\tarv_gv_stream"))
                .expect("the library's thread");
            assert!(stream.contains("Cpus_allowed_list:\t0\n"), "{stream}");
        },
    );
}

#[test]
fn found_by_serial_device_id_and_address() {
    in_namespace("gige::found_by_serial_device_id_and_address", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        let listed = list();
        let [identity] = &listed[..] else { panic!("one camera was expected, not {listed:?}") };
        assert_eq!(
            (&*identity.serial, &*identity.transport, &*identity.address),
            ("GV7", "GigEVision", ADDRESS)
        );
        for name in ["GV7", "Aravis-Fake-GV7", ADDRESS] {
            assert_eq!(open_aravis(name).unwrap().identity(), identity, "{name}");
        }
    });
}

#[test]
fn white_space_around_a_serial_is_none_of_it() {
    in_namespace("gige::white_space_around_a_serial_is_none_of_it", || {
        let _program = gige_vision::Camera::start(" GV7 ", 0);
        // The first time by a search, then where it was.
        for wanted in ["GV7", "GV7 "] {
            let mut source = kinds::source_of(&Source::Aravis { serial: wanted.into() });
            for _ in 0..2 {
                assert_eq!(source.open().unwrap().identity().serial, "GV7");
            }
        }
    });
}

#[test]
fn a_serial_controls_no_terminal() {
    in_namespace("gige::a_serial_controls_no_terminal", || {
        let _program = gige_vision::Camera::start("GV\u{1b}[2J7", 0);
        let listed = list();
        assert_eq!(listed[0].serial, "GV\u{fffd}[2J7");
        assert!(!open_aravis("GV8").unwrap_err().to_string().contains('\u{1b}'));
    });
}

#[test]
fn a_missing_camera_names_those_that_are_there() {
    in_namespace("gige::a_missing_camera_names_those_that_are_there", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        // A number is a serial, not the address 0.0.48.57.
        for wanted in ["GV8", "12345"] {
            let error = open_aravis(wanted).unwrap_err();
            assert!(matches!(error, CameraError::Absent { .. }), "{error}");
            let message = error.to_string();
            assert!(
                message.contains(wanted) && message.contains("\"GV7\" (GigEVision 127.0.0.1)"),
                "{message}"
            );
        }
    });
}

#[test]
fn an_address_without_a_camera_is_absent() {
    in_namespace("gige::an_address_without_a_camera_is_absent", || {
        let error = open_aravis(ADDRESS).unwrap_err();
        assert!(matches!(error, CameraError::Absent { .. }), "{error}");
    });
}

#[test]
fn a_camera_in_use_is_refused() {
    in_namespace("gige::a_camera_in_use_is_refused", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        let _first = open_aravis(ADDRESS).unwrap();
        let error = open_aravis(ADDRESS).unwrap_err();
        assert!(error.to_string().contains("another program controls it"), "{error}");
    });
}

#[test]
fn a_refused_setting_names_the_range() {
    in_namespace("gige::a_refused_setting_names_the_range", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        let mut camera = open_aravis(ADDRESS).unwrap();
        let error = camera.configure(&Settings { exposure_us: 1.0, ..SETTINGS }).unwrap_err();
        assert!(error.is_refusal() && error.to_string().contains("10 to 10000000"), "{error}");
        // Nothing of it sticks.
        assert_eq!(camera.configure(&SETTINGS).unwrap().exposure_us, 10_000.0);
    });
}

#[test]
fn only_whole_frames_are_complete_and_ids_tell_of_the_others() {
    in_namespace("gige::only_whole_frames_are_complete_and_ids_tell_of_the_others", || {
        let _program = gige_vision::Camera::start("GVLOSS", 2);
        let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
        camera.start().unwrap();
        let mut last_id = None;
        // Frames that came with a part missing since the last whole one.
        let (mut missing, mut lost) = (0, 0);
        for _ in 0..250 {
            match camera.next(PATIENCE).unwrap() {
                Event::Complete(mut capture) => {
                    assert!(is_ramp(capture.slot.pixels_mut(), 640), "frame {}", capture.frame_id);
                    if let Some(last_id) = last_id {
                        assert_eq!(capture.frame_id - last_id - 1, missing);
                        lost += missing;
                    }
                    last_id = Some(capture.frame_id);
                    missing = 0;
                    capture.slot.pixels_mut().fill(255);
                    camera.queue(capture.slot).unwrap();
                }
                Event::Incomplete(slot) => {
                    missing += 1;
                    camera.queue(slot).unwrap();
                }
                Event::Timeout => panic!("the camera stopped"),
            }
        }
        // 2 of 1000 packets, about 220 packets a frame: one frame in three.
        assert!(lost > 0, "no packet was lost");
    });
}

#[test]
fn frames_that_find_no_slot_are_counted() {
    in_namespace("gige::frames_that_find_no_slot_are_counted", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
        camera.start().unwrap();
        let held: Vec<_> = (0..SLOTS).map(|_| whole(camera.as_mut())).collect();
        let event = camera.next(Duration::from_millis(200)).unwrap();
        assert!(matches!(event, Event::Timeout), "{event:?} without a slot");
        // The camera draws its own count of frames: the ramp begins with it, modulo 255.
        let count = |capture: &mut Capture| (capture.frame_id, u64::from(capture.slot.pixels_mut()[0]));
        let (mut last_id, mut last_drawn) = (0, 0);
        for mut capture in held {
            (last_id, last_drawn) = count(&mut capture);
            camera.queue(capture.slot).unwrap();
        }
        // The first slot can come in the middle of a frame.
        let (next_id, drawn) = std::iter::repeat_with(|| camera.next(PATIENCE).unwrap())
            .find_map(|event| match event {
                Event::Complete(mut capture) => Some(count(&mut capture)),
                _ => None,
            })
            .unwrap();
        assert!(next_id - last_id > 1, "{next_id} follows {last_id}");
        assert_eq!(
            (next_id - last_id) % 255,
            (255 + drawn - last_drawn) % 255,
            "{next_id} follows {last_id}"
        );
    });
}

#[test]
fn a_killed_camera_is_disconnected_and_opens_again() {
    in_namespace("gige::a_killed_camera_is_disconnected_and_opens_again", || {
        let program = gige_vision::Camera::start("GV7", 0);
        let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
        camera.start().unwrap();
        let capture = whole(camera.as_mut());
        camera.queue(capture.slot).unwrap();
        drop(program);
        // Frames on their way, then the patience of the library's heartbeat, 5 s.
        let error = (0..20).find_map(|_| camera.next(PATIENCE).err()).expect("the loss is noticed");
        assert!(matches!(error, CameraError::Disconnected { .. }), "{error}");
        assert!(matches!(camera.next(PATIENCE), Err(CameraError::Disconnected { .. })));
        drop(camera);

        let _program = gige_vision::Camera::start("GV7", 0);
        let (mut camera, ..) = ready(ADDRESS, &SETTINGS);
        camera.start().unwrap();
        for frame_id in 0..25 {
            let capture = whole(camera.as_mut());
            assert_eq!(capture.frame_id, frame_id);
            camera.queue(capture.slot).unwrap();
        }
    });
}

#[test]
fn streams_without_the_right_to_packet_sockets() {
    in_namespace_without_net_raw("gige::streams_without_the_right_to_packet_sockets", || {
        let _program = gige_vision::Camera::start("GV7", 0);
        // A frame that the smallest usual socket buffer holds.
        let (mut camera, ..) = ready(ADDRESS, &Settings { width: 320, height: 200, ..SETTINGS });
        camera.start().unwrap();
        for frame_id in 0..50 {
            let mut capture = whole(camera.as_mut());
            assert_eq!(capture.frame_id, frame_id);
            assert!(is_ramp(capture.slot.pixels_mut(), 320));
            camera.queue(capture.slot).unwrap();
        }
    });
}
