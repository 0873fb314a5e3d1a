//! What killed programs leave behind.
//!
//! Files of other users are left alone: they are neither opened nor removed.

use std::collections::HashSet;
use std::fs::{self, DirEntry, Metadata};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::CallbackProgression;

use crate::log::quieten;
use crate::premises::{check_owner, is_foreign};
use crate::quirks::{self, CONTEXT, Ipc, SHARED_MEMORY};
use crate::settings::Settings;

/// Age at which a file that is not finished will never be: to finish it takes microseconds. Nobody signs in before, and a camera whose
/// process was killed is to be back within a second.
const HALF_MADE: Duration = Duration::from_millis(500);
/// How long a driver waits for others who clean up, and between looks.
const PATIENCE: Duration = Duration::from_millis(300);
const NAP: Duration = Duration::from_millis(5);

/// Releases what killed programs left behind: their places among the consumers, the slots they held, their files. Returns how
/// many programs there were.
///
/// Takes a few milliseconds: for a thread that has time, about once a second. What cannot be cleaned now is left for the next call.
pub fn cleanup_dead_nodes(settings: &Settings) -> usize {
    settings.to_iceoryx2().map_or(0, |config| cleanup(&config))
}

pub(crate) fn cleanup(config: &Config) -> usize {
    clean(config).0
}

/// The same for a driver that is about to make services in the place of a predecessor: it lets others finish who clean up after that one,
/// as they remove files by names that its own will have.
pub(crate) fn clear_the_way(config: &Config) {
    let give_up = Instant::now() + PATIENCE;
    while clean(config).1 > 0 && Instant::now() < give_up {
        std::thread::sleep(NAP);
    }
}

/// Returns how many killed programs were cleaned up after, and how many were not: others are at it, or nobody can.
fn clean(config: &Config) -> (usize, usize) {
    quieten();
    if check_owner(config).is_err() || half_made(config).is_some() {
        return (0, 0);
    }
    sweep(config);
    let (mut cleaned, mut left) = (0, 0);
    // An error leaves nodes for the next call, like a node that another process is just cleaning.
    let _ = Node::<Ipc>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            match quirks::remove_dead(&node, config) {
                true => cleaned += 1,
                false => left += 1,
            }
        }
        CallbackProgression::Continue
    });
    (cleaned, left)
}

/// Removes files whose program was killed while it made them, and returns one that is too young to tell.
///
/// iceoryx2 does not clean these up: to open such a service fails, and to open such a register never ends where the opener is root.
/// Nothing is to be opened while there is one.
pub(crate) fn half_made(config: &Config) -> Option<PathBuf> {
    let global = &config.global;
    type IsHalfMade = fn(&Metadata) -> bool;
    let folders: [(String, IsHalfMade); 3] = [
        (global.service_dir().to_string(), quirks::is_half_made_description),
        (global.node_dir().to_string(), quirks::is_half_made),
        (SHARED_MEMORY.to_owned(), quirks::is_half_made),
    ];
    let mut young = None;
    for (folder, is_half_made) in folders {
        for (file, found) in ours(config, folder.as_ref()) {
            // A segment takes its time.
            if quirks::is_segment(&name(&file), config) || !is_half_made(&found) {
                continue;
            }
            if is_old(&found) {
                let _ = fs::remove_file(file.path());
            } else {
                young = Some(file.path());
            }
        }
    }
    young
}

/// Removes slot segments that this program, which signed in as `node`, made and could not map: iceoryx2 leaves their files.
pub(crate) fn forget_segments(config: &Config, node: u128) {
    let Ok(maps) = fs::read_to_string("/proc/self/maps") else { return };
    for (file, _) in ours(config, SHARED_MEMORY.as_ref()) {
        let name = name(&file);
        if quirks::is_segment_of(&name, config, node) && !maps.contains(&name) {
            let _ = fs::remove_file(file.path());
        }
    }
}

/// Removes what is left of nodes whose program was killed while it signed in or out: iceoryx2 does not find these, or cannot remove them.
fn sweep(config: &Config) {
    let nodes = PathBuf::from(config.global.node_dir().to_string());
    let suffix = config.global.node.monitor_suffix;
    // Of every prefix: a node's folder is named by its number alone.
    let names: HashSet<String> =
        fs::read_dir(&nodes).into_iter().flatten().flatten().map(|file| name(&file)).collect();
    for (file, _) in ours(config, &nodes).filter(|(_, found)| is_old(found)) {
        let own = name(&file);
        let Some((node, _)) = own.rsplit_once(suffix.as_str()) else { continue };
        let is_whole = ["", CONTEXT].iter().all(|end| nodes.join(format!("{node}{suffix}{end}")).exists());
        if !is_whole {
            let _ = fs::remove_file(file.path());
        }
    }
    let folders = fs::read_dir(&nodes).into_iter().flatten().flatten();
    for folder in folders.filter(|folder| folder.file_type().is_ok_and(|kind| kind.is_dir())) {
        let monitor = format!("{}{suffix}", name(&folder));
        let is_ours = nodes.join(format!("{}{monitor}", config.global.prefix)).exists();
        sweep_folder(config, &folder, !is_ours && !names.iter().any(|name| name.contains(&monitor)));
    }
}

/// Removes half-made descriptions of a node, and all of a node that is no more.
fn sweep_folder(config: &Config, folder: &DirEntry, is_orphan: bool) {
    // Before it changes by what is removed from it.
    let is_gone = is_orphan && folder.metadata().is_ok_and(|found| is_old(&found));
    for (file, found) in ours(config, &folder.path()) {
        if is_old(&found) && (is_orphan || quirks::is_half_made_description(&found)) {
            let _ = fs::remove_file(file.path());
        }
    }
    if is_gone {
        // Not where another prefix has files there.
        let _ = fs::remove_dir(folder.path());
    }
}

/// The files of this prefix and user in a folder. One that is not there, and a file that another program has removed, are none.
fn ours(config: &Config, folder: &Path) -> impl Iterator<Item = (DirEntry, Metadata)> {
    let prefix = config.global.prefix;
    let files = fs::read_dir(folder).into_iter().flatten().flatten();
    files.filter_map(move |file| {
        let found = name(&file).starts_with(prefix.as_str()).then(|| file.metadata().ok())??;
        (found.is_file() && !is_foreign(&found)).then_some((file, found))
    })
}

fn name(file: &DirEntry) -> String {
    file.file_name().to_string_lossy().into_owned()
}

/// Whether a file will not change any more. One of the future was made before the clock was set back.
fn is_old(found: &Metadata) -> bool {
    let age = found.modified().map(|modified| SystemTime::now().duration_since(modified));
    age.is_ok_and(|age| age.map_or(true, |age| age > HALF_MADE))
}
