//! The driver where it may do only what its service allows.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::thread;

use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter, SeccompRule,
    apply_filter,
};
use uvcam_tests::{Stage, next_frame, simulated, stderr};

// socket(2), AF_INET and AF_INET6 of address_families(7), EAFNOSUPPORT of errno(3).
#[cfg(target_arch = "x86_64")]
const SOCKET: i64 = 41;
#[cfg(target_arch = "aarch64")]
const SOCKET: i64 = 198;
const INTERNET: [u64; 2] = [2, 10];
const NOT_SUPPORTED: u32 = 97;

/// Forbids internet sockets to this thread and the programs that it starts, as `RestrictAddressFamilies` of systemd.exec(5) does.
fn forbid_internet_sockets() {
    let family =
        |family| SeccompCondition::new(0, SeccompCmpArgLen::Dword, SeccompCmpOp::Eq, family).unwrap();
    let rules = INTERNET.map(|number| SeccompRule::new(vec![family(number)]).unwrap()).to_vec();
    let filter = SeccompFilter::new(
        BTreeMap::from([(SOCKET, rules)]),
        SeccompAction::Allow,
        SeccompAction::Errno(NOT_SUPPORTED),
        std::env::consts::ARCH.try_into().unwrap(),
    );
    apply_filter(&BpfProgram::try_from(filter.unwrap()).unwrap()).unwrap();
    assert!(std::net::UdpSocket::bind("127.0.0.1:0").is_err(), "internet sockets are still allowed");
}

#[test]
fn without_internet_sockets_an_absent_camera_costs_the_others_nothing() {
    let camera = |name: &str, serial: &str| {
        simulated(name, "none", "").replace(
            &format!("{{ kind = \"simulated\", serial = \"{name}\" }}"),
            &format!("{{ kind = \"aravis\", serial = \"{serial}\" }}"),
        )
    };
    let cameras =
        camera("absent", "NONE") + &camera("networked", "192.0.2.1") + &simulated("drawn", "none", "");
    let stage = Stage::new(&cameras);
    let driver = thread::scope(|scope| {
        let started = scope.spawn(|| {
            forbid_internet_sockets();
            stage.driver()
        });
        started.join().unwrap()
    });
    let mut subscriber = stage.subscriber("drawn");
    for _ in 0..60 {
        next_frame(&mut subscriber);
    }
    let output = driver.stop();
    let said = stderr(&output);
    // Ended by the request, not by the library.
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert!(said.contains("absent: aravis camera \"NONE\" is not connected"), "{said}");
    assert!(said.contains("this program may not use the network"), "{said}");
}
