//! What killed programs leave behind.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{DeadNodeView, Node, NodeDetails, NodeState, NodeView};
use iceoryx2::prelude::CallbackProgression;

use crate::log::quieten;
use crate::service::Ipc;
use crate::settings::{SHARED_MEMORY, Settings};

/// Age at which a file that is not finished will never be: to finish it takes microseconds.
const HALF_MADE: Duration = Duration::from_secs(1);
/// Mode of a service description that is being written: iceoryx2 takes its own right to write away when it has finished.
const UNFINISHED_DESCRIPTION: u32 = 0o600;
/// Mode of every other file that is being written: iceoryx2 gives itself the right to read when it has finished.
const UNFINISHED: u32 = 0o200;

/// Releases what killed programs left behind: their places among the consumers, the slots they held, their files. Returns how
/// many programs there were.
///
/// Takes a few milliseconds: for a thread that has time, about once a second. What cannot be cleaned now is left for the next call.
pub fn cleanup_dead_nodes(settings: &Settings) -> usize {
    settings.to_iceoryx2().map_or(0, |config| cleanup(&config))
}

pub(crate) fn cleanup(config: &Config) -> usize {
    quieten();
    if half_made(config).is_some() {
        return 0;
    }
    let mut cleaned = 0;
    // An error leaves nodes for the next call, like a node that another process is just cleaning.
    let _ = Node::<Ipc>::list(config, |state| {
        // The configuration is given explicitly: of a node that lost its own, iceoryx2 would take a file of the working directory.
        if let NodeState::Dead(node) = state
            && let details = NodeDetails::__internal_new(&None, config)
            && DeadNodeView::<Ipc>::__internal_try_remove_stale_resources(*node.id(), details).is_ok()
        {
            cleaned += 1;
        }
        CallbackProgression::Continue
    });
    cleaned
}

/// Removes files whose program was killed while it made them, and returns one that is too young to tell.
///
/// iceoryx2 does not clean these up: to open such a service fails, and to open such a register never ends where the opener is root.
/// Nothing is to be opened while there is one.
pub(crate) fn half_made(config: &Config) -> Option<PathBuf> {
    let global = &config.global;
    let services = (global.service_dir().to_string(), UNFINISHED_DESCRIPTION);
    let nodes = (global.node_dir().to_string(), UNFINISHED);
    let shared_memory = (SHARED_MEMORY.to_owned(), UNFINISHED);
    let folders = [services, nodes, shared_memory].into_iter();
    // A folder that is not there, or a file that another program has removed, is none that is half made.
    let files = folders
        .flat_map(|(folder, mode)| Some(fs::read_dir(folder).ok()?.flatten().map(move |file| (file, mode))));
    let mut young = None;
    for (file, unfinished) in files.flatten() {
        let name = file.file_name();
        // A slot segment takes its time, and is found through its owner alone.
        let is_concerned = name.to_str().is_some_and(|name| {
            name.starts_with(global.prefix.as_str())
                && !name.ends_with(global.service.data_segment_suffix.as_str())
        });
        if !is_concerned {
            continue;
        }
        let Ok(found) = file.metadata() else { continue };
        if !found.is_file() || found.permissions().mode() & 0o777 != unfinished {
            continue;
        }
        let age = found.modified().ok().and_then(|modified| modified.elapsed().ok());
        if age.is_some_and(|age| age > HALF_MADE) {
            let _ = fs::remove_file(file.path());
        } else {
            young = Some(file.path());
        }
    }
    young
}
