//! What this library knows of iceoryx2's inside, and iceoryx2 does not promise. All of it was read in, and tried with, the `VERSION` below; a test
//! fails where another one is used, until somebody has looked at every line of this table.
//!
//! | what iceoryx2 does | who relies on it |
//! | --- | --- |
//! | writes files under modes that tell finished from half made: [`is_half_made`], [`is_half_made_description`] | [`cleanup`](crate::cleanup), which nobody passes by while there is a half-made file |
//! | waits for a half-made register without end where the opener is root, and leaves half-made files of killed programs | the same |
//! | takes, of a dead node that lost its own configuration, a configuration file of the working directory: [`remove_dead`] gives it one | the same |
//! | names a node's files and folder by its number, and makes the mark [`CONTEXT`] first and removes it last | the same |
//! | keeps in each number that it makes the bits of the process: [`is_segment_of`] | the same, for segments that could not be mapped, whose files stay |
//! | cannot open or make a service whose description is there and whose register is not: [`description`] | [`service`](crate::service) |
//! | makes its register of nodes in `/dev/shm` with mode 0666, whatever `root_path` is, and writes its version into it last: [`registers`], [`has_version`] | [`premises`](crate::premises), [`settings`](crate::settings) |
//! | puts up to 46 bytes beside `root_path` and `prefix` into the path of a UNIX socket: [`LONGEST_PATHS`] | [`settings`](crate::settings) |
//! | has service ids, hashes and port numbers in the names of files: [`is_marked`] | [`footing`](crate::footing) |
//! | removes the files of a service by name when its last holder lets go, whoever made them | [`Held`](crate::footing::Held) |
//! | connects to a new port of the other side once, while it sends or receives, and waits there for `creation_timeout`: see [`Address::for_publisher`](crate::service::Address::for_publisher) | publisher, link, health, control |
//! | counts the frames in a subscriber's hands for each publisher, and passes over a publisher of whom it holds all it may | [`Subscriber`](crate::Subscriber) |
//! | keeps all slots of a publisher in one mapping, each behind its own header and ours | [`resident`](crate::resident), [`settings`](crate::settings) |
//! | does nothing with a received sample through a shared reference but read it, its length under the lock of [`Ipc`], and yet does not say that threads may share it: [`Received`] | [`Frame`](crate::Frame), [`Mask`](crate::Mask) |
//! | waits for an event by a socket's timeout in whole microseconds, of which none is for ever: [`SHORTEST_WAIT`] | [`link`](crate::Subscriber) |
//! | keeps the handle of each loan on the heap | the frame path's law of allocations |
//! | writes its log to stderr, waits until that is read, and panics where it is closed | [`log`](crate::log) |
//! | reports most faults of a system as `InternalError` | [`premises`](crate::premises), which looks before |

use std::fs::{self, Metadata};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{DeadNodeView, NodeDetails, NodeView};
use iceoryx2::prelude::{ZeroCopySend, ipc_threadsafe};
use iceoryx2::sample::Sample;
use iceoryx2::service::service_hash::ServiceHash;

/// The version that this file describes.
#[cfg(test)]
const VERSION: &str = "0.10.0";

/// The shortest wait for an event that ends.
pub(crate) const SHORTEST_WAIT: Duration = Duration::from_micros(1);

/// The kind of all ports: behind a mutex, so that slots and frames may go from thread to thread; 0.2 us a call over `ipc` where the cache
/// is warm.
pub(crate) type Ipc = ipc_threadsafe::Service;

/// A received sample, which threads may share.
#[derive(Debug)]
pub(crate) struct Received<H: ZeroCopySend>(Sample<Ipc, [u8], H>);

// SAFETY: all that this type does through a shared reference is to read header and payload, which nobody writes while the sample is held;
// iceoryx2 reads the length of the payload under the lock of `Ipc`, and releases the sample when its one owner drops it.
unsafe impl<H: ZeroCopySend + Sync> Sync for Received<H> {}

impl<H: ZeroCopySend> Received<H> {
    pub(crate) fn new(sample: Sample<Ipc, [u8], H>) -> Self {
        Received(sample)
    }

    pub(crate) fn header(&self) -> &H {
        self.0.user_header()
    }

    pub(crate) fn payload(&self) -> &[u8] {
        self.0.payload()
    }
}

/// Where iceoryx2 keeps its memory.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Bytes of `root_path` and `prefix` together: a UNIX socket's path has 107, of which iceoryx2 takes up to 46.
pub(crate) const LONGEST_PATHS: usize = 60;
/// End of the name of what a node makes first and removes last. In between there is the file that tells whether it is alive.
pub(crate) const CONTEXT: &str = "_context";

/// Mode of a description that is being written: iceoryx2 takes its own right to write away when it has finished.
const HALF_MADE_DESCRIPTION: u32 = 0o600;
/// Mode of every other file that is being written: iceoryx2 gives itself the right to read when it has finished.
const HALF_MADE: u32 = 0o200;
/// The owner's right to read.
const READ: u32 = 0o400;
/// Rights of group and others.
const OTHERS: u32 = 0o077;

/// Whether the description of a service or node is being written.
pub(crate) fn is_half_made_description(found: &Metadata) -> bool {
    mode(found) == HALF_MADE_DESCRIPTION
}

/// Whether any other file is being written.
pub(crate) fn is_half_made(found: &Metadata) -> bool {
    mode(found) == HALF_MADE
}

/// Whether a register is finished.
pub(crate) fn is_finished(found: &Metadata) -> bool {
    mode(found) & READ != 0
}

/// The mode that closes a file to other users, where it is open to them.
pub(crate) fn closed_to_others(found: &Metadata) -> Option<fs::Permissions> {
    let mode = mode(found);
    (mode & OTHERS != 0).then(|| fs::Permissions::from_mode(mode & !OTHERS))
}

fn mode(found: &Metadata) -> u32 {
    found.permissions().mode() & 0o777
}

/// Releases all that a dead node held. Returns whether it did.
pub(crate) fn remove_dead(node: &DeadNodeView<Ipc>, config: &Config) -> bool {
    let details = NodeDetails::__internal_new(&None, config);
    DeadNodeView::<Ipc>::__internal_try_remove_stale_resources(*node.id(), details).is_ok()
}

/// Whether a file of this name holds the slots of some publisher: it is made as large as they are, and found through its owner alone.
pub(crate) fn is_segment(name: &str, config: &Config) -> bool {
    name.ends_with(config.global.service.data_segment_suffix.as_str())
}

/// Whether a file of this name holds slots of a publisher of the process that signed in as `node`.
pub(crate) fn is_segment_of(name: &str, config: &Config, node: u128) -> bool {
    let suffix = config.global.service.data_segment_suffix;
    let number = name.strip_suffix(suffix.as_str()).and_then(|stem| stem.rsplit('_').next()?.parse().ok());
    number.is_some_and(|number: u128| (number >> 64) as u32 == (node >> 64) as u32)
}

/// Whether the name of a file is one of this prefix and holds one of these marks. Connections have those of both sides, and come and go
/// with consumers: they are none.
pub(crate) fn is_marked(name: &str, config: &Config, marks: &[String]) -> bool {
    let global = &config.global;
    name.starts_with(global.prefix.as_str())
        && !name.ends_with(global.service.connection_suffix.as_str())
        && marks.iter().any(|mark| name.contains(mark))
}

/// The file that describes a service.
pub(crate) fn description(config: &Config, hash: &ServiceHash) -> PathBuf {
    let global = &config.global;
    let name = format!("{}{hash}{}", global.prefix, global.service.static_config_storage_suffix);
    Path::new(&global.service_dir().to_string()).join(name)
}

/// The registers of nodes below this prefix and `root_path`: files that stay.
pub(crate) fn registers(config: &Config) -> impl Iterator<Item = (PathBuf, Metadata)> {
    let (prefix, suffix) = (config.global.prefix, config.global.node.global_mgmt_suffix);
    let files = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten().filter(move |file| {
        let name = file.file_name();
        let name = name.as_encoded_bytes();
        name.starts_with(prefix.as_str().as_bytes()) && name.ends_with(suffix.as_str().as_bytes())
    });
    files.filter_map(|file| Some((file.path(), file.metadata().ok()?)))
}

/// Whether a register that begins with these bytes has its version, which its maker writes last.
pub(crate) fn has_version(start: [u8; 8]) -> bool {
    start != [0; 8]
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use iceoryx2::prelude::{FileName, NodeBuilder, SemanticString};

    use super::*;

    #[test]
    fn the_version_is_the_one_that_was_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::default();
        config.global.prefix = FileName::new(format!("quirks{}_", std::process::id()).as_bytes()).unwrap();
        let root_path = folder.path().as_os_str().as_encoded_bytes();
        config.global.set_root_path(&iceoryx2::prelude::Path::new(root_path).unwrap());
        let node = NodeBuilder::new().config(&config).create::<Ipc>().unwrap();
        let (register, _) = registers(&config).next().expect("signing in makes a register");
        let mut start = [0; 8];
        fs::File::open(&register).unwrap().read_exact(&mut start).unwrap();
        drop(node);
        fs::remove_file(register).unwrap();
        assert!(has_version(start));
        let [major, minor, patch] = [32, 16, 0].map(|bits| (u64::from_ne_bytes(start) >> bits) as u16);
        assert_eq!(
            format!("{major}.{minor}.{patch}"),
            VERSION,
            "iceoryx2 has changed: go through the table of this file and try each line, then write the new version here"
        );
    }
}
