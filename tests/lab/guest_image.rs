//! The guest's file system: an initramfs of a shell, the modules, the programs under test and their libraries.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::MODULES;
use crate::kernel::Kernel;

const BUSYBOX: &str = "/bin/busybox";
/// Programs of this machine that the guest needs besides ours.
const PROGRAMS: [&str; 2] = ["/bin/udevadm", "/lib/udev/v4l_id"];
/// Rules that give device nodes their links and groups; ours come on top.
const RULES: [&str; 3] = [
    "/lib/udev/rules.d/50-udev-default.rules",
    "/lib/udev/rules.d/60-persistent-v4l.rules",
    concat!(env!("CARGO_MANIFEST_DIR"), "/../udev/70-uvcam.rules"),
];
const INIT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/lab/init");

/// Builds what is to be tested, lays the file system out in `folder`, and packs it.
pub fn build(folder: &Path, kernel: &Kernel) -> PathBuf {
    if folder.exists() {
        fs::remove_dir_all(folder).unwrap();
    }
    for name in ["bin", "dev", "etc", "lib/modules", "lib/systemd", "lib/udev/rules.d", "proc", "sys"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    install(Path::new(INIT), &folder.join("init"));
    install(Path::new(BUSYBOX), &folder.join("bin/busybox"));
    symlink("/bin/udevadm", folder.join("lib/systemd/systemd-udevd")).unwrap();
    fs::write(folder.join("etc/passwd"), "root:x:0:0::/:/bin/sh\n").unwrap();
    fs::copy("/etc/group", folder.join("etc/group")).unwrap();
    for rules in RULES.map(Path::new) {
        install(rules, &folder.join("lib/udev/rules.d").join(rules.file_name().unwrap()));
    }

    let mut libraries = BTreeSet::new();
    for program in PROGRAMS.map(Path::new) {
        install(program, &inside(folder, program));
        libraries.extend(libraries_of(program));
    }
    for (name, program) in [("guest", guest()), ("uvcam", uvcam_tests::binary().to_owned())] {
        install(&program, &folder.join("bin").join(name));
        // Nine tenths of an executable are for a debugger.
        run(Command::new("strip").arg("--strip-debug").arg(folder.join("bin").join(name)));
        libraries.extend(libraries_of(&program));
    }
    for library in libraries {
        install(&library, &inside(folder, &library));
    }

    let mut list = String::new();
    for (name, file) in kernel.in_loading_order(&MODULES.map(|(name, _)| name)) {
        install(&file, &folder.join("lib/modules").join(&name).with_extension("ko"));
        let parameters = MODULES.iter().find(|(module, _)| module.replace('-', "_") == name);
        list += &format!("{name} {}\n", parameters.map_or("", |(_, parameters)| parameters));
    }
    fs::write(folder.join("modules"), list).unwrap();
    pack(folder)
}

/// The program of `tests/guest`, built as this program was.
fn guest() -> PathBuf {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["test", "--locked", "--no-run", "--quiet", "--package", "uvcam-tests", "--test", "guest"]);
    cargo.args(["--message-format", "json"]).current_dir(env!("CARGO_MANIFEST_DIR"));
    let output = cargo.stderr(Stdio::inherit()).output().unwrap();
    assert!(output.status.success(), "the guest's tests were not built");
    let messages = String::from_utf8(output.stdout).unwrap();
    let executable = messages
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap())
        .filter(|message| message["target"]["name"] == "guest")
        .find_map(|message| message["executable"].as_str().map(PathBuf::from));
    executable.expect("cargo names the executable that it built")
}

/// The shared libraries that a program loads, and the loader.
fn libraries_of(program: &Path) -> BTreeSet<PathBuf> {
    let output = Command::new("ldd").arg(program).output().unwrap();
    assert!(output.status.success(), "ldd {}", program.display());
    let text = String::from_utf8(output.stdout).unwrap();
    text.split_whitespace().filter(|word| word.starts_with('/')).map(PathBuf::from).collect()
}

/// The place in `folder` that is `path` for the guest.
fn inside(folder: &Path, path: &Path) -> PathBuf {
    folder.join(path.strip_prefix("/").unwrap())
}

fn install(from: &Path, to: &Path) {
    fs::create_dir_all(to.parent().unwrap()).unwrap();
    fs::copy(from, to).unwrap_or_else(|error| panic!("{}: {error}", from.display()));
    let mode = fs::metadata(to).unwrap().permissions().mode();
    fs::set_permissions(to, fs::Permissions::from_mode(mode | 0o200)).unwrap();
}

/// Packs the folder the way the kernel unpacks it.
fn pack(folder: &Path) -> PathBuf {
    let image = folder.with_extension("cpio");
    run(Command::new(BUSYBOX)
        .args(["sh", "-c", "busybox find . | busybox cpio --quiet -o -H newc"])
        .current_dir(folder)
        .stdout(File::create(&image).unwrap()));
    image
}

fn run(command: &mut Command) {
    let status = command.status().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(status.success(), "{command:?}: {status}");
}
