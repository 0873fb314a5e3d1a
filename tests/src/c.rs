//! libuvcam of this build, and programs in C and C++ that use it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use uvcam_shm_ipc::Settings;

use crate::{built, stderr};

/// The folder of the package.
pub fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shm_ipc/c")
}

/// A folder of this build for what is made here.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        // Together with the driver, so that what both are made of is built once, with the same features.
        let folder = built(&["--package", "uvcam", "--package", "uvcam-c", "--lib", "--bin", "uvcam"]);
        let place = folder.join("libuvcam");
        let _ = std::fs::remove_dir_all(&place);
        let mut make = Command::new("make");
        make.args(["--silent", "install", "PREFIX=/opt/uvcam"]).current_dir(package());
        make.arg(format!("LIBRARY={}", folder.join("libuvcam_c.so").display()));
        make.arg(format!("DESTDIR={}", place.display()));
        succeeds(&mut make);
        place
    })
}

/// The prefix below which libuvcam is installed.
pub fn prefix() -> PathBuf {
    folder().join("opt/uvcam")
}

/// Runs a command to its end, which must be a good one.
pub fn succeeds(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{command:?}: {}\n{said}\n{}", output.status, stderr(&output));
    output
}

/// What pkg-config says of it.
pub fn pkg_config(words: &[&str]) -> Vec<String> {
    let mut command = Command::new("pkg-config");
    command.args(words).arg("uvcam").env("PKG_CONFIG_PATH", prefix().join("lib/pkgconfig"));
    command.env("PKG_CONFIG_SYSROOT_DIR", folder());
    let output = succeeds(&mut command);
    String::from_utf8(output.stdout).unwrap().split_whitespace().map(str::to_owned).collect()
}

/// Builds a program.
pub fn compiled(source: &Path, name: &str, flags: &[&str]) -> PathBuf {
    let program = folder().join(name);
    let is_c = source.extension().is_some_and(|extension| extension == "c");
    let mut compiler = Command::new(if is_c { "cc" } else { "c++" });
    compiler.args(["-Wall", "-Wextra", "-pedantic", "-Werror", "-pthread"]).args(flags);
    compiler.arg(source).arg("-o").arg(&program).args(pkg_config(&["--cflags", "--libs"]));
    succeeds(&mut compiler);
    program
}

/// A program that reads a camera.
pub fn consumer(program: &Path, settings: Settings, camera: &str) -> Command {
    let mut command = Command::new(program);
    command.arg(camera).arg(settings.prefix).arg(settings.root_path);
    command.env("LD_LIBRARY_PATH", prefix().join("lib"));
    command
}
