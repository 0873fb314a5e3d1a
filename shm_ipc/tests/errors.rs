//! Every error, produced, and what it says: the value, the place and the remedy.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::fs;
use std::os::unix::fs::chown;
use std::path::PathBuf;

use rustix::fs::statvfs;
use rustix::process::{Resource, Rlimit, setrlimit};
use support::child::{Role, role, say};
use support::namespace::with_shared_memory;
use support::*;
use uvcam_shm_ipc::control::{ControlClient, ControlServer, control_service_name};
use uvcam_shm_ipc::health::{HealthPublisher, HealthReader, health_service_name};
use uvcam_shm_ipc::iceoryx2::prelude::*;
use uvcam_shm_ipc::{
    FrameHeader, IpcError, IpcErrorKind, PixelFormat, Publisher, Settings, Subscriber, cleanup_dead_nodes,
    frame_service_name,
};

/// A user that the tests do not run as.
const NOBODY: u32 = 65534;

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    let (resource, room) = match role.as_str() {
        "few files" => (Resource::Nofile, open_files() + 8),
        "little address space" => (Resource::As, mapped_bytes() + (1 << 20)),
        unknown => panic!("no role {unknown}"),
    };
    setrlimit(resource, Rlimit { current: Some(room), maximum: Some(room) }).unwrap();
    for error in everyone(&settings) {
        match resource {
            Resource::Nofile => {
                assert_eq!(error.kind(), IpcErrorKind::TooFewFiles, "{error}");
                let message = error.message();
                let (begin, _) = message.split_once(" more are needed").unwrap();
                assert!(begin.rsplit(' ').next().unwrap().parse::<u64>().unwrap() >= 16, "{error}");
                says(&error, &[&room.to_string(), "ulimit -n"]);
            }
            _ => {
                assert_eq!(error.kind(), IpcErrorKind::AddressSpace, "{error}");
                says(&error, &["ulimit -v"]);
            }
        }
    }
    say("refused");
}

fn open_files() -> u64 {
    fs::read_dir("/proc/self/fd").unwrap().count() as u64
}

fn mapped_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.strip_suffix("kB"));
    line.unwrap().trim().parse::<u64>().unwrap() << 10
}

#[track_caller]
fn says(error: &impl ToString, words: &[&str]) {
    let text = error.to_string();
    words.iter().for_each(|word| assert!(text.contains(word), "{word}: {text}"));
}

/// What each of the six programs that sign in is told.
fn everyone(settings: &Settings) -> [IpcError; 6] {
    [
        Publisher::create(settings, CAMERA, FRAME_BYTES, LOANS).map(drop).unwrap_err(),
        HealthPublisher::create(settings, CAMERA).map(drop).unwrap_err(),
        ControlServer::create(settings, CAMERA).map(drop).unwrap_err(),
        wait_for_error(settings),
        HealthReader::open(settings, CAMERA).map(drop).unwrap_err(),
        ControlClient::open(settings, CAMERA).map(drop).unwrap_err(),
    ]
}

/// A consumer may hope for a while that it passes.
fn wait_for_error(settings: &Settings) -> IpcError {
    match Subscriber::open(settings, CAMERA) {
        Err(error) => error,
        Ok(mut subscriber) => subscriber.wait(PATIENCE).unwrap_err(),
    }
}

fn give_to_nobody(file: impl AsRef<std::path::Path>) {
    chown(file, Some(NOBODY), Some(NOBODY)).expect("run the tests as root: a file must change its owner");
}

#[test]
fn names_and_numbers_that_cannot_be() {
    let place = Place::new();
    let error = place.subscriber_of("le ft").unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::CameraName, "{error}");
    says(&error, &["\"le ft\"", "1 to 64 letters"]);
    for (settings, key, allowed) in [
        (with(place.settings.clone(), |it| it.buffer = 257), "buffer = 257", "1 to 256"),
        (with(place.settings.clone(), |it| it.borrowed = 0), "borrowed = 0", "1 to 64"),
        (with(place.settings.clone(), |it| it.max_subscribers = 65), "max_subscribers = 65", "1 to 64"),
        (with(place.settings.clone(), |it| it.prefix = "a/b".into()), "prefix = \"a/b\"", "1 to 32 letters"),
        (
            with(place.settings.clone(), |it| it.root_path = "here".into()),
            "root_path = here",
            "absolute path",
        ),
    ] {
        let error = Subscriber::open(&settings, CAMERA).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::Setting, "{error}");
        says(&error, &[key, allowed]);
    }
}

#[test]
fn services_and_frames_that_somebody_holds() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let error = Publisher::create(&place.settings, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::AlreadyPublishing, "{error}");
    says(&error, &["\"left\"", "another running driver", "another camera name or prefix"]);

    let mut subscriber = place.subscriber();
    let _second = place.subscriber();
    let error = place.subscriber_of(CAMERA).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::TooManyConsumers, "{error}");
    says(&error, &[&frame_service_name(CAMERA), "stop one", "max_subscribers"]);

    let held: Vec<_> = (0..place.settings.borrowed as u64)
        .map(|sequence| {
            publish(&mut publisher, 7, sequence);
            receive(&mut subscriber)
        })
        .collect();
    publish(&mut publisher, 7, 9);
    let error = subscriber.receive().unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::TooManyHeld, "{error}");
    says(&error, &["\"left\"", "drop one", "borrowed"]);

    let slots: Vec<_> = (0..LOANS).map(|_| publisher.loan().unwrap()).collect();
    says(&publisher.loan().unwrap_err(), &["all 3 slots", "drop one"]);
    drop(slots);

    drop(publisher);
    let larger = with(place.settings.clone(), |it| it.buffer = 8);
    let error = Publisher::create(&larger, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::Incompatible, "{error}");
    says(&error, &[&frame_service_name(CAMERA), "stop its consumers", "same settings and version"]);
    drop(held);
}

#[test]
fn a_driver_of_another_version_is_named_with_ours() {
    let place = Place::new();
    drop(place.publisher());
    let page = wake_words(&place).remove(0);
    let mut bytes = fs::read(&page).unwrap();
    bytes[4] = 9;
    fs::write(&page, bytes).unwrap();
    // One that has ended is no obstacle.
    assert!(!place.subscriber().is_connected());
    let node = NodeBuilder::new().config(&place.settings.to_iceoryx2().unwrap());
    let node = node.create::<ipc_threadsafe::Service>().unwrap();
    let name = ServiceName::new("uvcam/v9/left/frames").unwrap();
    let _service = node.service_builder(&name).publish_subscribe::<u64>().create().unwrap();
    for error in [
        place.subscriber_of(CAMERA).unwrap_err(),
        HealthReader::open(&place.settings, CAMERA).map(drop).unwrap_err(),
        ControlClient::open(&place.settings, CAMERA).map(drop).unwrap_err(),
    ] {
        assert_eq!(error.kind(), IpcErrorKind::OtherVersion, "{error}");
        says(&error, &["\"left\"", "version 9", "this program has version 2", "of one version"]);
    }
    assert!(!place.subscriber_of("right").unwrap().is_connected());
}

#[test]
fn health_and_control_tell_whoever_comes_too_late_that_all_places_are_taken() {
    let place = Place::new();
    let (settings, health, control) =
        (&place.settings, health_service_name(CAMERA), control_service_name(CAMERA));
    let _publisher = HealthPublisher::create(settings, CAMERA).unwrap();
    let _readers: Vec<_> = (0..16).map(|_| HealthReader::open(settings, CAMERA).unwrap().unwrap()).collect();
    let error = HealthReader::open(settings, CAMERA).map(drop).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::TooManyConsumers, "{error}");
    says(&error, &[&health, "stop one"]);
    let _server = ControlServer::create(settings, CAMERA).unwrap();
    let _clients: Vec<_> = (0..4).map(|_| ControlClient::open(settings, CAMERA).unwrap().unwrap()).collect();
    let error = ControlClient::open(settings, CAMERA).map(drop).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::TooManyConsumers, "{error}");
    says(&error, &[&control, "stop one"]);
}

#[test]
fn a_header_that_does_not_describe_its_frame() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let header = FrameHeader::new(2 * WIDTH, HEIGHT, 2 * WIDTH, PixelFormat::Mono8);
    let error = publisher.publish(publisher.loan().unwrap(), &header).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::Header, "{error}");
    says(&error, &["frame not published"]);
}

#[test]
fn what_the_system_refuses_is_told_with_its_place() {
    let place = Place::new();
    let publisher = place.publisher();
    let wake = wake_words(&place).remove(0);
    drop(publisher);
    fs::remove_file(&wake).unwrap();
    fs::create_dir(&wake).unwrap();
    let error = Publisher::create(&place.settings, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
    fs::remove_dir(&wake).unwrap();
    assert_eq!(error.kind(), IpcErrorKind::System, "{error}");
    says(&error, &["creating the wake word", wake.to_str().unwrap(), "Is a directory"]);
}

/// The pages of this place in `/dev/shm`.
fn wake_words(place: &Place) -> Vec<PathBuf> {
    let names = place.shared_memory().into_iter().map(|(name, _)| name);
    names.filter(|name| name.ends_with(".wake")).map(|name| PathBuf::from("/dev/shm").join(name)).collect()
}

#[test]
fn a_root_path_of_another_user_is_refused_before_anything_is_made() {
    let place = Place::new();
    let root_path = place.settings.root_path.clone();
    fs::create_dir(&root_path).unwrap();
    give_to_nobody(&root_path);
    for error in everyone(&place.settings) {
        assert_eq!(error.kind(), IpcErrorKind::Permission, "{error}");
        says(&error, &[root_path.to_str().unwrap(), "user nobody", "sudo -u nobody", "sudo rm -r"]);
    }
    assert_eq!(fs::read_dir(&root_path).unwrap().count(), 0);
    assert_eq!(place.shared_memory(), []);
}

#[test]
fn dead_nodes_of_another_user_are_left_alone() {
    let place = Place::new();
    let driver = place.publisher();
    let nodes = place.settings.root_path.join("nodes");
    // As the killed program of another user leaves it.
    let leftover = nodes.join("12345");
    fs::create_dir(&leftover).unwrap();
    age(&leftover);
    give_to_nobody(&place.settings.root_path);
    assert_eq!(cleanup_dead_nodes(&place.settings), 0);
    assert!(leftover.exists());
    drop(driver);
}

/// Makes a file as old as one that was never finished.
fn age(path: &std::path::Path) {
    let hour = std::time::Duration::from_secs(3600);
    fs::File::open(path).unwrap().set_modified(std::time::SystemTime::now() - hour).unwrap();
}

#[test]
fn files_of_another_user_are_named_and_not_touched() {
    let place = Place::new();
    let publisher = place.publisher();
    let names = place.shared_memory().into_iter().map(|(name, _)| name);
    let register = names.filter(|name| name.ends_with(".global_mgmt")).map(|name| format!("/dev/shm/{name}"));
    let files: Vec<_> = register.map(PathBuf::from).chain(wake_words(&place)).collect();
    assert_eq!(files.len(), 2, "{files:?}");
    drop(publisher);
    for file in files {
        fs::write(&file, "planted").unwrap();
        give_to_nobody(&file);
        let error = Publisher::create(&place.settings, CAMERA, FRAME_BYTES, LOANS).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::Foreign, "{error}");
        says(&error, &[file.to_str().unwrap(), "user nobody", "sudo rm", "another prefix"]);
        assert_eq!(fs::read_to_string(&file).unwrap(), "planted");
        fs::remove_file(&file).unwrap();
    }
    place.publisher();
}

#[test]
fn a_full_shared_memory_is_told_to_whoever_comes() {
    with_shared_memory("size=8m", "a_full_shared_memory_is_told_to_whoever_comes", || {
        let place = Place::new();
        let too_large = 2 << 20;
        let error = Publisher::create(&place.settings, CAMERA, too_large, LOANS).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::SharedMemoryFull, "{error}");
        says(
            &error,
            &["(15 slots)", "/dev/shm has 8 MB free", "\"left\" needs 3", "--shm-size", "max_subscribers"],
        );
        // Somebody flies already; then another program takes all there is.
        let mut publisher = place.publisher();
        let health = HealthPublisher::create(&place.settings, CAMERA).unwrap();
        let (mut subscriber, mut reader) =
            (place.subscriber(), HealthReader::open(&place.settings, CAMERA).unwrap().unwrap());
        meet(&publisher, &mut subscriber);
        let free = statvfs("/dev/shm").unwrap();
        let bytes = usize::try_from(free.f_bavail * free.f_frsize).unwrap();
        fs::write("/dev/shm/full", vec![1; bytes]).unwrap();
        let other = with(place.settings.clone(), |it| it.root_path = place.folder.path().join("other"));
        for error in everyone(&place.settings).into_iter().chain(everyone(&other)) {
            assert_eq!(error.kind(), IpcErrorKind::NoRoom, "{error}");
            says(&error, &["/dev/shm is full", "0 kB", "kB needed", "--shm-size or --ipc=host"]);
        }
        // Who was there goes on, through every slot and record.
        for sequence in 0..100 {
            publish(&mut publisher, 7, sequence);
            assert_pixels(&receive(&mut subscriber));
            health.publish(&uvcam_shm_ipc::health::Health::new()).unwrap();
            reader.wait(PATIENCE).unwrap().unwrap();
        }
    });
}

#[test]
fn a_full_shared_memory_takes_no_question_and_no_answer() {
    with_shared_memory("size=16m", "a_full_shared_memory_takes_no_question_and_no_answer", || {
        let place = Place::new();
        let server = ControlServer::create(&place.settings, CAMERA).unwrap();
        let client = ControlClient::open(&place.settings, CAMERA).unwrap().unwrap();
        let _replies = client.request("first").unwrap();
        let mut question = None;
        wait_until("the question", || {
            question = server.receive().unwrap();
            question.is_some()
        });
        let free = statvfs("/dev/shm").unwrap();
        fs::write("/dev/shm/full", vec![1; usize::try_from(free.f_bavail * free.f_frsize).unwrap()]).unwrap();
        assert!(!question.unwrap().reply(&"x".repeat(200_000)));
        let error = client.request(&"x".repeat(200_000)).map(drop).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::NoRoom, "{error}");
    });
}

#[test]
fn a_read_only_shared_memory_is_told_to_whoever_comes() {
    with_shared_memory("ro", "a_read_only_shared_memory_is_told_to_whoever_comes", || {
        for error in everyone(&Place::new().settings) {
            assert_eq!(error.kind(), IpcErrorKind::Unwritable, "{error}");
            says(&error, &["/dev/shm cannot be written", "ead-only", "remount,rw", "--ipc=host"]);
        }
    });
}

#[test]
fn a_limit_of_open_files_is_told_with_its_remedy() {
    let place = Place::new();
    let _publisher = place.publisher();
    let child = Role::start("few files", &place.settings);
    child.expect("refused");
    child.leave();
}

#[test]
fn a_limit_of_address_space_is_told_with_its_remedy() {
    let place = Place::new();
    let _publisher = place.publisher();
    let child = Role::start("little address space", &place.settings);
    child.expect("refused");
    child.leave();
}
