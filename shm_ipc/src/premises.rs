//! What must be true before a program signs in.
//!
//! iceoryx2 reports most of what is wrong with a system as `InternalError`, waits without end for some of it, and writes to files that a full
//! `/dev/shm` does not hold, which ends a process with SIGBUS. So all of it is looked at before anything is opened or made.

use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use rustix::fs::{Access, AtFlags, CWD, FlockOperation, StatVfsMountFlags, accessat, flock, statvfs};
use rustix::io::Errno;
use rustix::process::{Resource, geteuid, getrlimit};

use crate::error::{Fault, IpcError};
use crate::quirks::{self, SHARED_MEMORY};
use crate::settings::ROOM_BYTES;

/// Names of files in `/dev/shm` that must be free beside the bytes.
const ROOM_FILES: u64 = 32;
/// Open files of a consumer, or of the driver's end of health or control, with those that are open for an instant.
pub(crate) const FILES: u64 = 16;
/// Address space of the same.
pub(crate) const MAPPED_BYTES: u64 = 4 << 20;
/// How long to wait for others that take shared memory: far longer than it takes.
const LONGEST_TURN: Duration = Duration::from_secs(2);
const TURN_RETRY: Duration = Duration::from_millis(2);
/// What `/etc/passwd` may hold to be searched for a name.
const LONGEST_PASSWD: u64 = 4 << 20;

/// Compares the owner of `root_path`, where it exists, with the user of this program.
///
/// # Errors
/// [`Fault::Permission`]: shared memory is the owner's alone, and whoever else signs in costs everyone frames.
pub(crate) fn check_owner(config: &Config) -> Result<(), IpcError> {
    let root_path = Path::new(config.global.root_path().as_str());
    match fs::metadata(root_path) {
        Ok(found) if is_foreign(&found) => Err(not_ours(root_path, &found)),
        // It lies in a folder that is closed to this user.
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {
            let closed = root_path.ancestors().find_map(|folder| fs::metadata(folder).ok());
            closed.map_or(Ok(()), |found| Err(not_ours(root_path, &found)))
        }
        _ => Ok(()),
    }
}

/// Whether `root_path` is there: without it, no driver runs or has run.
pub(crate) fn has_root_path(config: &Config) -> bool {
    Path::new(config.global.root_path().as_str()).exists()
}

/// Checks all that signing in relies on, with `files` more open files and `mapped_bytes` more of address space.
///
/// # Errors
/// [`IpcError`]: what is missing, where, and what mends it.
pub(crate) fn check(config: &Config, files: u64, mapped_bytes: u64) -> Result<(), IpcError> {
    check_owner(config)?;
    check_shared_memory()?;
    check_root_path(config)?;
    check_open_files(files)?;
    check_address_space(mapped_bytes)?;
    mend_management(config)
}

/// Looks whether `/dev/shm` is there, may be written to, and is not full.
///
/// # Errors
/// [`Fault::Unwritable`] and [`Fault::NoRoom`].
pub(crate) fn check_shared_memory() -> Result<(), IpcError> {
    check_writable(Path::new(SHARED_MEMORY))?;
    check_room(0)
}

/// Looks whether `/dev/shm` has room for `bytes` and for the small files of those who sign in.
///
/// # Errors
/// [`Fault::NoRoom`], or [`Fault::Unwritable`] where there is no such place.
pub(crate) fn check_room(bytes: u64) -> Result<(), IpcError> {
    let found = statvfs(SHARED_MEMORY).map_err(|error| unwritable(Path::new(SHARED_MEMORY), error.into()))?;
    let need_bytes = bytes.saturating_add(ROOM_BYTES);
    let free_bytes = found.f_bavail.saturating_mul(found.f_frsize);
    // A file system without a limit of its files says 0 of 0.
    let has_names = found.f_files == 0 || found.f_favail >= ROOM_FILES;
    if free_bytes >= need_bytes && has_names {
        return Ok(());
    }
    Err(Fault::NoRoom { need_bytes, free_bytes, free_files: found.f_favail }.into())
}

/// Keeps other drivers of this `root_path` from counting the same free bytes, from the look at `/dev/shm` until the memory is taken: as long
/// as the file is open.
///
/// `None` where one of them holds on to its turn, stopped perhaps: that must not keep the others on the ground.
pub(crate) fn take_turn(config: &Config) -> Option<File> {
    let folder = File::open(config.global.root_path().to_string()).ok()?;
    let give_up = Instant::now() + LONGEST_TURN;
    loop {
        match flock(&folder, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => return Some(folder),
            Err(Errno::WOULDBLOCK | Errno::INTR) if Instant::now() < give_up => thread::sleep(TURN_RETRY),
            Err(_) => return None,
        }
    }
}

/// Fails where a file that others find by its name belongs to another user, who could change it under our eyes.
///
/// # Errors
/// [`Fault::Foreign`].
pub(crate) fn check_ours(file: &Path) -> Result<(), IpcError> {
    match fs::symlink_metadata(file) {
        Ok(found) if is_foreign(&found) => {
            Err(Fault::Foreign { file: file.to_owned(), owner: name_of(found.uid()) }.into())
        }
        _ => Ok(()),
    }
}

/// Whether a file belongs to another user than this program runs as.
pub(crate) fn is_foreign(file: &Metadata) -> bool {
    file.uid() != geteuid().as_raw()
}

/// Takes the right to change iceoryx2's register of nodes from other users: it is made with mode 0666.
pub(crate) fn close_management(config: &Config) {
    for (file, found) in quirks::registers(config) {
        if !is_foreign(&found)
            && quirks::is_finished(&found)
            && let Some(mode) = quirks::closed_to_others(&found)
        {
            // Who just removed it took the right as well.
            let _ = fs::set_permissions(file, mode);
        }
    }
}

fn check_root_path(config: &Config) -> Result<(), IpcError> {
    let root_path = Path::new(config.global.root_path().as_str());
    // Where it is not there yet, whatever is there of its path must let it be made.
    match root_path.ancestors().find(|folder| folder.exists()) {
        Some(folder) => check_writable(folder),
        None => Ok(()),
    }
}

fn check_writable(folder: &Path) -> Result<(), IpcError> {
    if !folder.is_dir() && folder.exists() {
        return Err(unwritable(folder, io::ErrorKind::NotADirectory.into()));
    }
    match accessat(CWD, folder, Access::WRITE_OK | Access::EXEC_OK, AtFlags::EACCESS) {
        // Nothing is told to a program that was given another user's rights.
        Ok(()) | Err(Errno::NOSYS) => {}
        Err(error) => return Err(unwritable(folder, error.into())),
    }
    // Root may write everywhere, but not where nobody may.
    match statvfs(folder) {
        Ok(found) if found.f_flag.contains(StatVfsMountFlags::RDONLY) => {
            Err(unwritable(folder, io::ErrorKind::ReadOnlyFilesystem.into()))
        }
        _ => Ok(()),
    }
}

fn unwritable(folder: &Path, cause: io::Error) -> IpcError {
    let place = folder.display();
    let is_shared_memory = folder == Path::new(SHARED_MEMORY);
    let mut remedy = match cause.kind() {
        io::ErrorKind::NotFound => format!("sudo mkdir -p {place} && sudo mount -t tmpfs tmpfs {place}"),
        io::ErrorKind::ReadOnlyFilesystem => format!("sudo mount -o remount,rw {place}"),
        io::ErrorKind::NotADirectory => format!("sudo rm {place}"),
        _ if is_shared_memory => format!("sudo chmod 1777 {place}"),
        _ => {
            let owner = fs::metadata(folder).map_or_else(|_| "root".to_owned(), |found| name_of(found.uid()));
            format!("run as its owner (sudo -u {owner} ...), or use another root_path in [ipc]")
        }
    };
    if is_shared_memory {
        remedy += "; in a container: --ipc=host, or --shm-size with a size that suffices";
    }
    Fault::Unwritable { place: folder.to_owned(), remedy, source: cause }.into()
}

fn check_open_files(need: u64) -> Result<(), IpcError> {
    let Some(limit) = getrlimit(Resource::Nofile).current else { return Ok(()) };
    let open = match fs::read_dir("/proc/self/fd") {
        Ok(files) => files.count() as u64,
        // To count them takes one.
        Err(error) if error.raw_os_error() == Some(Errno::MFILE.raw_os_error()) => limit,
        // What cannot be counted is not held against anyone.
        Err(_) => 0,
    };
    if limit.saturating_sub(open) < need {
        Err(Fault::TooFewFiles { limit, open, need }.into())
    } else {
        Ok(())
    }
}

fn check_address_space(need_bytes: u64) -> Result<(), IpcError> {
    match address_space_left() {
        Some(left_bytes) if left_bytes < need_bytes => {
            Err(Fault::AddressSpace { left_bytes, need_bytes }.into())
        }
        _ => Ok(()),
    }
}

/// Bytes that this program may still map (`ulimit -v`); `None` without a limit.
pub(crate) fn address_space_left() -> Option<u64> {
    let limit = getrlimit(Resource::As).current?;
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let mapped = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.strip_suffix("kB"));
    let mapped_bytes = mapped?.trim().parse::<u64>().ok()?.saturating_mul(1024);
    Some(limit.saturating_sub(mapped_bytes))
}

/// Refuses a register of another user, and removes one of ours that another user made useless: iceoryx2 would wait for it without end.
fn mend_management(config: &Config) -> Result<(), IpcError> {
    for (file, found) in quirks::registers(config) {
        check_ours(&file)?;
        if quirks::is_finished(&found) && !has_version(&file) {
            let _ = fs::remove_file(&file);
        }
    }
    Ok(())
}

fn has_version(register: &Path) -> bool {
    let mut start = [0; 8];
    let read = File::open(register).and_then(|mut file| file.read_exact(&mut start));
    match read {
        Ok(()) => quirks::has_version(start),
        // Shorter than that.
        Err(error) => error.kind() != io::ErrorKind::UnexpectedEof,
    }
}

/// The error of a program that runs as another user than the owner of `place`.
fn not_ours(place: &Path, found: &Metadata) -> IpcError {
    Fault::Permission {
        root_path: place.to_owned(),
        owner: name_of(found.uid()),
        user: name_of(geteuid().as_raw()),
    }
    .into()
}

/// The error of a program that iceoryx2 found without rights, in spite of all.
pub(crate) fn no_access(config: &Config) -> IpcError {
    let root_path = Path::new(config.global.root_path().as_str());
    let user = name_of(geteuid().as_raw());
    let owner = fs::metadata(root_path).map_or_else(|_| user.clone(), |found| name_of(found.uid()));
    Fault::Permission { root_path: root_path.to_owned(), owner, user }.into()
}

/// The name that `/etc/passwd` (passwd(5)) gives to a user, else the number.
fn name_of(user: u32) -> String {
    let mut text = Vec::new();
    let read = File::open("/etc/passwd").and_then(|file| file.take(LONGEST_PASSWD).read_to_end(&mut text));
    let text = read.map_or_else(|_| String::new(), |_| String::from_utf8_lossy(&text).into_owned());
    let name = text.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(user)).then_some(name)
    });
    name.map_or_else(|| user.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_have_the_name_of_passwd_or_their_number() {
        assert_eq!(name_of(0), "root");
        assert_eq!(name_of(3_999_999_999), "3999999999");
    }
}
