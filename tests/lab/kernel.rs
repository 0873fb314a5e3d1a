//! The kernel: an unpacked package of Debian, its modules and what they depend on.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// An unpacked kernel package.
pub struct Kernel {
    /// What the machine boots.
    pub image: PathBuf,
    modules: PathBuf,
    /// Of each module its file and those it depends on, directly or not, by name.
    dependencies: HashMap<String, (PathBuf, Vec<String>)>,
}

impl Kernel {
    /// Looks into `folder`, which is laid out as the root of a system.
    pub fn find(folder: &Path) -> Self {
        let image = only_entry(&folder.join("boot"), "vmlinuz-");
        let modules = only_entry(&folder.join("lib/modules"), "");
        let list = modules.join("modules.dep");
        let list = fs::read_to_string(&list).unwrap_or_else(|error| panic!("{}: {error}", list.display()));
        let dependencies = list.lines().filter_map(entry).collect();
        Kernel { image, modules, dependencies }
    }

    /// These modules behind all that they depend on: name and file of each, in the order in which they can be loaded.
    pub fn in_loading_order(&self, names: &[&str]) -> Vec<(String, PathBuf)> {
        let mut order = Vec::new();
        for name in names {
            self.append(&canonical(name), &mut order);
        }
        order
    }

    fn append(&self, name: &str, order: &mut Vec<(String, PathBuf)>) {
        if order.iter().any(|(present, _)| present == name) {
            return;
        }
        let (file, dependencies) =
            self.dependencies.get(name).unwrap_or_else(|| panic!("the kernel has no module {name}"));
        for dependency in dependencies {
            self.append(dependency, order);
        }
        order.push((name.to_owned(), self.modules.join(file)));
    }
}

/// The only entry of a folder whose name begins with `prefix`.
fn only_entry(folder: &Path, prefix: &str) -> PathBuf {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut entries: Vec<PathBuf> = entries
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix))
        .map(|entry| entry.path())
        .collect();
    assert_eq!(entries.len(), 1, "{} must hold one {prefix}*: {entries:?}", folder.display());
    entries.remove(0)
}

/// A line of modules.dep: `kernel/drivers/a.ko: kernel/drivers/b.ko ...`.
fn entry(line: &str) -> Option<(String, (PathBuf, Vec<String>))> {
    let (file, dependencies) = line.split_once(':')?;
    let file = file.trim_start_matches("./");
    Some((name(file), (file.into(), dependencies.split_whitespace().map(name).collect())))
}

fn name(file: &str) -> String {
    canonical(file.rsplit('/').next().unwrap().split('.').next().unwrap())
}

/// Modules are written with either character.
fn canonical(name: &str) -> String {
    name.replace('-', "_")
}
