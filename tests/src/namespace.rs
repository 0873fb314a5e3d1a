//! Namespaces of a test's own, by unshare(1).

use std::process::{Command, Stdio};

/// The options of unshare(1) for these namespaces. Root makes them; anyone else needs a user namespace around them, which containers and
/// chroots may forbid.
pub fn options<'a>(namespaces: &[&'a str]) -> Vec<&'a str> {
    first_possible([namespaces.to_vec(), [namespaces, &["--map-root-user"]].concat()])
}

/// The first of these sets of options with which unshare(1) starts a program here.
pub fn first_possible<const N: usize>(choices: [Vec<&str>; N]) -> Vec<&str> {
    let is_possible = |options: &Vec<&str>| {
        let mut unshare = Command::new("unshare");
        let status = unshare.args(options).arg("true").stdin(Stdio::null()).stderr(Stdio::null()).status();
        status.expect("unshare: install the package util-linux").success()
    };
    let told = format!("unshare fails with each of {choices:?}: run as root, or allow user namespaces");
    choices.into_iter().find(is_possible).expect(&told)
}
