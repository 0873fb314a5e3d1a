//! What driver and consumers agree on, and the memory it takes.

use std::mem::size_of;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, Path, SemanticString};
use iceoryx2::service::header::publish_subscribe::Header;

use crate::error::SettingError;
use crate::header::FrameHeader;
use crate::quirks::LONGEST_PATHS;

/// What must be free in `/dev/shm` for anybody to sign in: some pages, and never more than a tenth of this.
pub(crate) const ROOM_BYTES: u64 = 1 << 20;

/// How long a service or connection that another program is just making may take to be finished. Bounds what a program killed in
/// between costs those who come after it.
const CREATION_TIMEOUT: Duration = Duration::from_millis(200);

/// Where the services live and how much a consumer may lag. `prefix` and `root_path` are the address: driver and consumers must
/// agree. The numbers are the driver's to choose; consumers take what they find.
///
/// ```
/// let mut settings = uvcam_shm_ipc::Settings::new("uvcam_", "/run/uvcam");
/// settings.borrowed = 8;
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Settings {
    /// Start of the name of every file in `/dev/shm` and `root_path`.
    pub prefix: String,
    /// Folder of the service files; absolute. It belongs to the user who runs the driver.
    pub root_path: PathBuf,
    /// Consumers that may read one camera at the same time, 1 to 64.
    pub max_subscribers: usize,
    /// Frames that a consumer may lag behind before it loses the oldest, 1 to 256.
    pub buffer: usize,
    /// Frames that a consumer may hold at the same time, 1 to 64.
    pub borrowed: usize,
}

impl Default for Settings {
    /// 8 consumers; 12 frames of lag, a fifth of a second at 60 fps, as long as a busy onboard computer may keep a process
    /// waiting; 4 held frames. With 6 loans that is 134 slots: 49 MB for 752x480, 78 MB for 960x600, 309 MB for 1920x1200.
    fn default() -> Self {
        Settings {
            prefix: "uvcam_".to_owned(),
            root_path: PathBuf::from("/tmp/uvcam"),
            max_subscribers: 8,
            buffer: 12,
            borrowed: 4,
        }
    }
}

impl Settings {
    /// An address, and the numbers of [`Settings::default`].
    pub fn new(prefix: impl Into<String>, root_path: impl Into<PathBuf>) -> Self {
        Settings { prefix: prefix.into(), root_path: root_path.into(), ..Settings::default() }
    }

    /// Slots that one camera needs so that no consumer, however slow, can take the last:
    /// `max_subscribers * (buffer + borrowed) + loans`, with `loans` slots in the hands of the driver.
    pub fn slots_needed(&self, loans: usize) -> usize {
        slots_needed(self.max_subscribers, self.buffer, self.borrowed, loans)
    }

    /// Bytes of `/dev/shm` that one camera needs, for frames of `frame_bytes` and `loans` slots in the hands of the driver.
    pub fn shared_memory_needed(&self, frame_bytes: usize, loans: usize) -> u64 {
        shared_memory_needed(self.slots_needed(loans), frame_bytes)
    }

    /// Checks what driver and consumers will be refused for, without making anything.
    ///
    /// # Errors
    /// [`SettingError`]: the first setting outside its limits.
    pub fn validate(&self) -> Result<(), SettingError> {
        self.to_iceoryx2().map(drop)
    }

    /// Bytes of `/dev/shm` that several cameras and their consumers need; each camera as in [`Settings::shared_memory_needed`].
    pub fn shared_memory_of_all(&self, frame_bytes: impl IntoIterator<Item = usize>, loans: usize) -> u64 {
        let cameras = frame_bytes.into_iter().map(|bytes| self.shared_memory_needed(bytes, loans));
        cameras.fold(ROOM_BYTES, u64::saturating_add)
    }

    /// The configuration of [`iceoryx2`], from these settings alone: no file is read. For a consumer with a `WaitSet` of its own, which opens
    /// the event service [`wake_service_name`](crate::wake_service_name) with it.
    ///
    /// # Errors
    /// As [`Settings::validate`].
    pub fn to_iceoryx2(&self) -> Result<Config, SettingError> {
        self.check_number("max_subscribers", self.max_subscribers, 64, "1 to 64")?;
        self.check_number("buffer", self.buffer, 256, "1 to 256 frames")?;
        self.check_number("borrowed", self.borrowed, 64, "1 to 64 frames")?;
        let prefix = FileName::new(self.prefix.as_bytes()).ok().filter(|_| is_name(&self.prefix, 32));
        let Some(prefix) = prefix else {
            let found = format!("\"{}\"", self.prefix);
            return Err(SettingError::new("prefix", found, "1 to 32 letters, digits, \"_\" or \"-\""));
        };
        let refused = |allowed| SettingError::new("root_path", self.root_path.display(), allowed);
        let bytes = self.root_path.as_os_str().as_encoded_bytes();
        if !self.root_path.is_absolute() || bytes.len() + self.prefix.len() > LONGEST_PATHS {
            return Err(refused("an absolute path of at most 60 bytes together with prefix"));
        }
        let Ok(root_path) = Path::new(bytes) else {
            return Err(refused("only ASCII letters, digits and signs other than < > \" | ? * in root_path"));
        };
        let mut config = Config::default();
        config.global.prefix = prefix;
        config.global.set_root_path(&root_path);
        // iceoryx2's register of nodes lies in /dev/shm: another root_path has another one.
        let suffix = format!(".{}.global_mgmt", tag(&self.root_path));
        if let Ok(suffix) = FileName::new(suffix.as_bytes()) {
            config.global.node.global_mgmt_suffix = suffix;
        }
        config.global.creation_timeout = CREATION_TIMEOUT;
        // Cleaning is done where it may take its time, by `cleanup_dead_nodes`.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(config)
    }

    fn check_number(
        &self,
        key: &'static str,
        found: usize,
        most: usize,
        allowed: &'static str,
    ) -> Result<(), SettingError> {
        match found {
            1.. if found <= most => Ok(()),
            _ => Err(SettingError::new(key, found, allowed)),
        }
    }
}

pub(crate) fn slots_needed(max_subscribers: usize, buffer: usize, borrowed: usize, loans: usize) -> usize {
    max_subscribers.saturating_mul(buffer.saturating_add(borrowed)).saturating_add(loans)
}

pub(crate) fn shared_memory_needed(slots: usize, frame_bytes: usize) -> u64 {
    /// Queues and registers beside the slots.
    const BOOKKEEPING: u64 = 1 << 20;
    let alignment = align_of::<FrameHeader>();
    let headers = size_of::<Header>().next_multiple_of(alignment) + size_of::<FrameHeader>();
    let slot_bytes = (headers as u64).saturating_add(frame_bytes as u64).next_multiple_of(alignment as u64);
    (slots as u64).saturating_mul(slot_bytes).saturating_add(BOOKKEEPING)
}

/// What stands for a `root_path` in the name of a file in `/dev/shm`: 16 digits, the FNV-1a hash of its path without links and detours.
fn tag(root_path: &std::path::Path) -> String {
    let path = std::fs::canonicalize(root_path).unwrap_or_else(|_| root_path.components().collect());
    let fold = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
    let hash = path.as_os_str().as_encoded_bytes().iter().fold(0xcbf2_9ce4_8422_2325, fold);
    format!("{hash:016x}")
}

/// Whether `text` is made of letters, digits, `_` and `-`, and of 1 to `longest` of them.
pub(crate) fn is_name(text: &str, longest: usize) -> bool {
    (1..=longest).contains(&text.len())
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_path_has_one_tag_however_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let (root, link) = (folder.path().join("root"), folder.path().join("link"));
        std::fs::create_dir(&root).unwrap();
        std::os::unix::fs::symlink(&root, &link).unwrap();
        assert_eq!(tag(&link), tag(&root));
        assert_eq!(tag(&folder.path().join("./root/")), tag(&root));
        assert_ne!(tag(folder.path()), tag(&root));
        // The offset basis of FNV-1a, the byte exclusive or-ed to it, times the prime.
        assert_eq!(tag(std::path::Path::new("/")), "af63a24c860189fe");
    }
}
