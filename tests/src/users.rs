//! A second user on this machine, for tests of who may do what.

use std::process::Command;

/// "nobody": no user's files belong to it.
const OTHER: &str = "65534";

/// The command, to be run as another user than this test's. Only root can do that: a test that cannot has failed.
///
/// What it reads and writes must be accessible to everybody.
pub fn other(command: &Command) -> Command {
    assert!(rustix::process::geteuid().is_root(), "needs a second user: run it as root");
    let mut other = Command::new("setpriv");
    other.args(["--reuid", OTHER, "--regid", OTHER, "--clear-groups", "--"]);
    other.arg(command.get_program()).args(command.get_args());
    other
}
