//! A second user on this machine, for tests of who may do what.

use std::path::Path;
use std::process::Command;

/// "nobody": no user's files belong to it.
const OTHER: u32 = 65534;

/// The command, to be run as another user than this test's. Only root can do that: a test that cannot has failed.
///
/// What it reads and writes must be accessible to everybody.
pub fn other(command: &Command) -> Command {
    assert!(rustix::process::geteuid().is_root(), "needs a second user: run it as root");
    let mut other = Command::new("setpriv");
    let id = OTHER.to_string();
    other.args(["--reuid", &id, "--regid", &id, "--clear-groups", "--"]);
    other.arg(command.get_program()).args(command.get_args());
    other
}

/// Makes the other user the owner of a folder, which everybody may enter.
pub fn give_to_other(folder: &Path) {
    std::os::unix::fs::chown(folder, Some(OTHER), Some(OTHER)).unwrap();
    let enter = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(folder, enter).unwrap();
}
