//! `make install` and `make uninstall` in a folder, and the service that they install.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;
use uvcam_tests::{binary, stderr};

/// A folder in place of `/`, in which `make install` was called.
struct Installation {
    root: TempDir,
}

impl Installation {
    fn new() -> Self {
        let installation = Installation { root: tempfile::tempdir().unwrap() };
        let output = installation.make("install", binary());
        assert!(output.status.success(), "{}", stderr(&output));
        installation
    }

    fn make(&self, target: &str, binary: &Path) -> Output {
        Command::new("make")
            .arg("--directory")
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap())
            .arg(target)
            .arg("PREFIX=/opt/uvcam")
            .arg(format!("DESTDIR={}", self.root.path().display()))
            .arg(format!("BINARY={}", binary.display()))
            .stdin(Stdio::null())
            .output()
            .unwrap()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    /// Every file with its mode.
    fn files(&self) -> BTreeMap<String, u32> {
        let (mut files, mut folders) = (BTreeMap::new(), vec![self.root.path().to_owned()]);
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
                match entry.metadata().unwrap() {
                    metadata if metadata.is_dir() => folders.push(entry.path()),
                    metadata => {
                        let name = entry.path().strip_prefix(self.root.path()).unwrap().display().to_string();
                        files.insert(name, metadata.permissions().mode() & 0o7777);
                    }
                }
            }
        }
        files
    }

    /// The service, with the binary where it is while the test runs.
    fn unit(&self) -> PathBuf {
        let text = fs::read_to_string(self.path("opt/uvcam/lib/systemd/system/uvcam.service")).unwrap();
        let program = "ExecStart=/opt/uvcam/bin/uvcam ";
        assert!(text.contains(program), "{text}");
        let unit = self.path("uvcam.service");
        let here = format!("ExecStart={} ", self.path("opt/uvcam/bin/uvcam").display());
        fs::write(&unit, text.replace(program, &here)).unwrap();
        unit
    }
}

fn systemd_analyze(words: &[&str], unit: &Path) -> Output {
    let mut command = Command::new("systemd-analyze");
    command.args(words).arg(unit).output().expect("systemd-analyze: install the package systemd")
}

#[test]
fn every_file_has_its_place_and_mode() {
    let expected = [
        ("etc/uvcam/uvcam.toml", 0o644),
        ("opt/uvcam/bin/uvcam", 0o755),
        ("opt/uvcam/lib/systemd/system/uvcam.service", 0o644),
        ("opt/uvcam/lib/sysusers.d/uvcam.conf", 0o644),
        ("opt/uvcam/lib/udev/rules.d/70-uvcam.rules", 0o644),
        ("opt/uvcam/share/uvcam/network.conf", 0o644),
    ];
    let expected: BTreeMap<String, u32> =
        expected.into_iter().map(|(name, mode)| (name.into(), mode)).collect();
    let installation = Installation::new();
    assert_eq!(installation.files(), expected);

    let output = Command::new(installation.path("opt/uvcam/bin/uvcam")).arg("--version").output().unwrap();
    assert!(output.status.success() && output.stdout.starts_with(b"uvcam "), "{}", stderr(&output));
}

#[test]
fn the_installed_configuration_flies() {
    let installation = Installation::new();
    let config = installation.path("etc/uvcam/uvcam.toml");
    let text = fs::read_to_string(&config).unwrap();
    // The service's folder is made by systemd.
    let folder = installation.path("run");
    assert!(text.contains("root_path = \"/run/uvcam\""), "{text}");
    let prefix = format!("uv{}_", std::process::id());
    let text =
        text.replace("root_path = \"/run/uvcam\"", &format!("root_path = {folder:?}\nprefix = \"{prefix}\""));
    fs::write(&config, text).unwrap();
    let mut command = Command::new(installation.path("opt/uvcam/bin/uvcam"));
    let output = command.args(["run", "--duration", "1", "--config"]).arg(&config).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn an_installation_keeps_a_changed_configuration_and_uninstall_removes_all_else() {
    let installation = Installation::new();
    let config = installation.path("etc/uvcam/uvcam.toml");
    fs::write(&config, "# ours\n").unwrap();
    assert!(installation.make("install", binary()).status.success());
    assert_eq!(fs::read_to_string(&config).unwrap(), "# ours\n");
    assert!(installation.make("uninstall", binary()).status.success());
    assert_eq!(installation.files().into_keys().collect::<Vec<_>>(), ["etc/uvcam/uvcam.toml"]);

    let installation = Installation::new();
    assert!(installation.make("uninstall", binary()).status.success());
    assert!(installation.files().is_empty(), "{:?}", installation.files());
}

#[test]
fn nothing_is_installed_without_a_binary() {
    let installation = Installation { root: tempfile::tempdir().unwrap() };
    let output = installation.make("install", Path::new("/nowhere/uvcam"));
    assert!(!output.status.success() && stderr(&output).contains("make build"), "{}", stderr(&output));
    assert!(installation.files().is_empty());
}

#[test]
fn systemd_understands_the_service() {
    let installation = Installation::new();
    let output = systemd_analyze(&["verify"], &installation.unit());
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));

    // With the drop-in for GigE Vision as well.
    let drop_in = installation.path("uvcam.service.d/network.conf");
    fs::create_dir(drop_in.parent().unwrap()).unwrap();
    fs::copy(installation.path("opt/uvcam/share/uvcam/network.conf"), drop_in).unwrap();
    let output = systemd_analyze(&["verify"], &installation.unit());
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));
}

#[test]
fn the_service_is_hardened() {
    // systemd's measure of what a service may do, from 0 to 10, times ten; its own services have 10 to 30.
    let words = ["security", "--offline=true", "--threshold=20"];
    let installation = Installation::new();
    let output = systemd_analyze(&words, &installation.unit());
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    // The measure is one that can fail.
    let unit = installation.unit();
    let text = fs::read_to_string(&unit).unwrap();
    fs::write(
        &unit,
        text.replace("SystemCallFilter=@system-service\n", "").replace("CapabilityBoundingSet=\n", ""),
    )
    .unwrap();
    assert!(!systemd_analyze(&words, &unit).status.success());
}
