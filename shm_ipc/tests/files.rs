//! Files that programs leave behind, share, or lose.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use support::child::{Role, publish_on_demand, role};
use support::*;
use uvcam_shm_ipc::cleanup_dead_nodes;
use uvcam_shm_ipc::control::{ControlClient, ControlServer};
use uvcam_shm_ipc::health::{Health, HealthPublisher, HealthReader};

const HOUR: Duration = Duration::from_secs(3600);

/// The other processes of these tests.
#[test]
#[ignore = "runs as a child of other tests"]
fn child() {
    let (role, settings) = role();
    assert_eq!(role, "driver");
    publish_on_demand(&settings);
}

/// A file with this mode, made at this time.
fn plant(path: impl AsRef<Path>, mode: u32, time: SystemTime) {
    fs::write(&path, "").unwrap();
    fs::File::open(&path).unwrap().set_modified(time).unwrap();
    fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
}

/// Paths of this place in `/dev/shm` whose names end so.
fn shared(place: &Place, end: &str) -> Vec<PathBuf> {
    let names = place.shared_memory().into_iter().map(|(name, _)| name);
    names.filter(|name| name.ends_with(end)).map(|name| PathBuf::from("/dev/shm").join(name)).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder).unwrap();
    files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_half_made_file_of_the_future_is_old() {
    let place = Place::new();
    let register = format!("/dev/shm/{}half.dynamic", place.settings.prefix);
    plant(&register, 0o200, SystemTime::now() + HOUR);
    let publisher = place.publisher();
    let mut subscriber = place.subscriber();
    meet(&publisher, &mut subscriber);
    assert!(!fs::exists(register).unwrap());
}

#[test]
fn a_register_that_another_user_emptied_is_made_anew() {
    let place = Place::new();
    drop(place.publisher());
    for spoilt in [&b""[..], &[0; 16]] {
        let register = shared(&place, ".global_mgmt").remove(0);
        fs::write(&register, spoilt).unwrap();
        fs::set_permissions(&register, Permissions::from_mode(0o666)).unwrap();
        drop(place.publisher());
    }
}

#[test]
fn nobody_else_may_write_to_files_in_shared_memory() {
    let place = Place::new();
    let publisher = place.publisher();
    let (_health, _control) = (
        HealthPublisher::create(&place.settings, CAMERA).unwrap(),
        ControlServer::create(&place.settings, CAMERA).unwrap(),
    );
    let mut subscriber = place.subscriber();
    meet(&publisher, &mut subscriber);
    for file in shared(&place, "") {
        let mode = fs::metadata(&file).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode, 0o600, "{}", file.display());
    }
}

#[test]
fn the_memory_of_small_files_and_frames_is_taken_when_they_are_made() {
    let place = Place::new();
    let publisher = place.publisher();
    let _health = HealthPublisher::create(&place.settings, CAMERA).unwrap();
    let _control = ControlServer::create(&place.settings, CAMERA).unwrap();
    let mut subscriber = place.subscriber();
    meet(&publisher, &mut subscriber);
    let _client = ControlClient::open(&place.settings, CAMERA).unwrap().unwrap();
    let _reader = HealthReader::open(&place.settings, CAMERA).unwrap().unwrap();
    let files = shared(&place, "").into_iter().map(|file| (fs::metadata(&file).unwrap(), file));
    // Requests and replies are long and rare: their memory is looked for when they are written.
    let small: Vec<_> = files.filter(|(found, _)| found.len() <= 1 << 20).collect();
    assert!(small.len() >= 10, "{small:?}");
    for (found, file) in small {
        // stat(2) counts blocks of 512 bytes.
        assert!(found.blocks() * 512 >= found.len(), "{} has holes", file.display());
    }
}

#[test]
fn what_killed_programs_left_of_their_nodes_is_swept() {
    let place = Place::new();
    let prefix = &place.settings.prefix;
    let alive = place.publisher();
    let nodes = place.settings.root_path.join("nodes");
    let before = names(&nodes);
    let old = SystemTime::now() - HOUR;
    // Killed between description and monitor; with a tag half made; while its monitor was removed, or made.
    let folder = |number: &str, file: &str, mode| {
        fs::create_dir(nodes.join(number)).unwrap();
        plant(nodes.join(number).join(file), mode, old);
        fs::File::open(nodes.join(number)).unwrap().set_modified(old).unwrap();
    };
    folder("11111", &format!("{prefix}node.details"), 0o400);
    folder("22222", &format!("{prefix}half.service_tag"), 0o600);
    plant(nodes.join(format!("{prefix}33333.node_monitor_context")), 0o400, old);
    plant(nodes.join(format!("{prefix}33333.node_monitor_owner_lock")), 0o600, old);
    plant(nodes.join(format!("{prefix}44444.node_monitor")), 0o600, old);
    // Another prefix in the same folder, which begins alike; and somebody who is just signing in.
    let other = with(place.settings.clone(), |it| it.prefix = format!("{prefix}more_"));
    let neighbour = uvcam_shm_ipc::Publisher::create(&other, CAMERA, FRAME_BYTES, LOANS).unwrap();
    let neighbours: Vec<_> = names(&nodes).into_iter().filter(|name| !before.contains(name)).collect();
    fs::create_dir(nodes.join("55555")).unwrap();
    cleanup_dead_nodes(&place.settings);
    let left = names(&nodes);
    for swept in ["11111", "22222", "33333", "44444"] {
        assert!(!left.iter().any(|name| name.contains(swept)), "{swept}: {left:?}");
    }
    let stays = neighbours.iter().filter(|name| !["11111", "22222"].contains(&name.as_str()));
    for name in before.iter().chain(stays).filter(|name| !name.contains("33333") && !name.contains("44444")) {
        assert!(left.contains(name), "{name}: {left:?}");
    }
    assert!(left.contains(&"55555".to_owned()));
    for node in nodes.read_dir().unwrap().flatten().filter(|node| node.path().is_dir()) {
        let is_new = node.file_name() == "55555";
        assert!(is_new || !names(&node.path()).is_empty(), "{}", node.path().display());
    }
    drop((alive, neighbour));
}

#[test]
fn killed_drivers_leave_nothing_below_root_path() {
    let place = Place::new();
    // Killed at moments that come as they come, while they sign in and out.
    for round in 0..20 {
        let driver = Role::start("driver", &place.settings);
        if round % 2 == 0 {
            driver.expect("ready");
        } else {
            let nodes = place.settings.root_path.join("nodes");
            wait_until("a sign of it", || fs::read_dir(&nodes).is_ok_and(|mut nodes| nodes.next().is_some()));
        }
        driver.kill();
    }
    let nodes = place.settings.root_path.join("nodes");
    // What is young may still be in the making.
    wait_until("nothing left", || {
        cleanup_dead_nodes(&place.settings);
        names(&nodes).is_empty()
    });
    place.publisher();
}

#[test]
fn two_root_paths_with_one_prefix_share_nothing() {
    let place = Place::new();
    let mut one = place.publisher();
    let files = place.shared_memory();
    let settings = with(place.settings.clone(), |it| it.root_path = place.folder.path().join("other"));
    let other = uvcam_shm_ipc::Publisher::create(&settings, CAMERA, FRAME_BYTES, LOANS).unwrap();
    assert_eq!(shared(&place, ".wake").len(), 2);
    assert_eq!(shared(&place, ".global_mgmt").len(), 2);
    let mut subscriber = place.subscriber();
    meet(&one, &mut subscriber);
    drop(other);
    for (name, _) in &files {
        assert!(fs::exists(Path::new("/dev/shm").join(name)).unwrap(), "{name}");
    }
    assert!(one.footing().is_in_place());
    // A sleeper is still woken, and not only by the end of its sleep.
    std::thread::scope(|scope| {
        let received = scope.spawn(|| receive(&mut subscriber).header().sequence);
        publish(&mut one, 7, 0);
        assert_eq!(received.join().unwrap(), 0);
    });
}

#[test]
fn who_loses_a_file_notices() {
    let place = Place::new();
    let publisher = place.publisher();
    let health = HealthPublisher::create(&place.settings, CAMERA).unwrap();
    let control = ControlServer::create(&place.settings, CAMERA).unwrap();
    let footings = [publisher.footing(), health.footing(), control.footing()];
    assert!(footings.iter().all(|footing| footing.is_in_place()));
    let mut noticed = [0; 3];
    let services = fs::read_dir(place.settings.root_path.join("services")).unwrap().flatten();
    let files: Vec<_> = services.map(|file| file.path()).chain(shared(&place, "")).collect();
    for file in &files {
        let aside = file.with_extension("aside");
        fs::rename(file, &aside).unwrap();
        for (count, footing) in noticed.iter_mut().zip(footings) {
            *count += usize::from(!footing.is_in_place());
        }
        fs::rename(&aside, file).unwrap();
        // Another file of the same name is not the same file.
        fs::copy(file, &aside).unwrap();
        let kept = file.with_extension("kept");
        fs::rename(file, &kept).unwrap();
        fs::rename(&aside, file).unwrap();
        assert!(
            file.ends_with("none") || footings.iter().any(|footing| !footing.is_in_place()) == is_owned(file)
        );
        fs::rename(&kept, file).unwrap();
    }
    // Two descriptions, two registers, slots and the wake word; one description, one register and slots each.
    assert_eq!(noticed, [6, 3, 3], "{files:?}");
}

/// Whether a service stands on this file; the register of nodes is made anew by whoever needs it.
fn is_owned(file: &Path) -> bool {
    !file.to_string_lossy().ends_with(".global_mgmt")
}

#[test]
fn what_is_made_anew_is_found_by_those_who_were_there_and_those_who_come() {
    let place = Place::new();
    let mut publisher = place.publisher();
    let health = HealthPublisher::create(&place.settings, CAMERA).unwrap();
    let control = ControlServer::create(&place.settings, CAMERA).unwrap();
    let mut subscriber = place.subscriber();
    meet(&publisher, &mut subscriber);
    publish(&mut publisher, 1, 0);
    assert_pixels(&receive(&mut subscriber));
    let mut ends = (publisher, health, control);
    for epoch in 2..6 {
        // As logind does when a user logs out, and every second time as cleaners of temporary files do.
        shared(&place, "").iter().for_each(|file| fs::remove_file(file).unwrap());
        if epoch % 2 == 0 {
            fs::remove_dir_all(&place.settings.root_path).unwrap();
        }
        drop(ends);
        ends = (
            place.publisher(),
            HealthPublisher::create_at_once(&place.settings, CAMERA).unwrap(),
            ControlServer::create_at_once(&place.settings, CAMERA).unwrap(),
        );
        let (publisher, health, control) = &mut ends;
        meet(publisher, &mut subscriber);
        publish(publisher, epoch, 0);
        assert!(receive(&mut subscriber).epoch_changed());
        health.publish(&Health::new()).unwrap();
        let mut reader = HealthReader::open(&place.settings, CAMERA).unwrap().unwrap();
        health.serve_newcomers().unwrap();
        assert!(reader.wait(PATIENCE).unwrap().is_some());
        assert!(ControlClient::open(&place.settings, CAMERA).unwrap().is_some());
        // Who let go of what was before has not removed what came after.
        assert!(
            [publisher.footing(), health.footing(), control.footing()].iter().all(|one| one.is_in_place())
        );
    }
}

#[test]
fn who_only_looks_for_a_driver_makes_no_root_path() {
    let place = Place::new();
    assert!(HealthReader::open(&place.settings, CAMERA).unwrap().is_none());
    assert!(ControlClient::open(&place.settings, CAMERA).unwrap().is_none());
    assert!(!place.subscriber().wait(Duration::from_millis(60)).unwrap());
    assert!(!place.settings.root_path.exists());
    assert_eq!(place.shared_memory(), []);
}
