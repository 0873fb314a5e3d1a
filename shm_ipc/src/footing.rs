//! Whether the files that others find a service by are still those that it was made with.
//!
//! Cleaners of temporary files remove them under a running program, as does a logind with `RemoveIPC=yes` (logind.conf(5)) when the user logs
//! out. Who has them open goes on; who comes later finds nothing. The program that made them is the only one that can make them anew.

use std::fs;
use std::io;
use std::mem;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;
use iceoryx2::prelude::PortFactory;

use crate::error::IpcError;
use crate::quirks::{self, SHARED_MEMORY};

/// The files of one service, each with the device and inode that its name led to at the beginning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Footing(Vec<(PathBuf, Inode)>);

type Inode = (u64, u64);

impl Footing {
    /// The files whose names hold one of these numbers and hashes: services, ports and nodes, by which iceoryx2 names its files.
    pub(crate) fn of(config: &Config, marks: &[String]) -> Self {
        let global = &config.global;
        let (services, nodes) = (global.service_dir().to_string(), global.node_dir().to_string());
        let folders = [SHARED_MEMORY.to_owned(), services, nodes].into_iter();
        // What cannot be seen now is not missed later.
        let files = folders.flat_map(|folder| fs::read_dir(folder).into_iter().flatten().flatten());
        let ours = files.filter(|file| quirks::is_marked(&file.file_name().to_string_lossy(), config, marks));
        let mut footing = Footing(Vec::new());
        ours.for_each(|file| footing.add(file.path()));
        footing
    }

    pub(crate) fn add(&mut self, file: PathBuf) {
        if let Ok(inode) = inode(&file) {
            self.0.push((file, inode));
        }
    }

    /// Whether every name still leads where it led. Takes some microseconds: for a thread that has time, about once a second.
    pub fn is_in_place(&self) -> bool {
        self.0.iter().all(|(file, then)| match inode(file) {
            Ok(now) => now == *then,
            // What cannot be seen is not gone.
            Err(error) => error.kind() != io::ErrorKind::NotFound,
        })
    }

    /// Keeps one end of a service where others find it: makes it anew with `create` where it is missing, or its files are no longer in
    /// place. To be called about once a second.
    ///
    /// # Errors
    /// Those of `create`: `end` is then missing, until the next call.
    pub fn keep<T>(
        end: &mut Option<T>,
        footing: impl Fn(&T) -> &Footing,
        create: impl FnOnce() -> Result<T, IpcError>,
    ) -> Result<(), IpcError> {
        // One must be gone before its successor comes: their files have the same names.
        *end = end.take().filter(|end| footing(end).is_in_place());
        if end.is_none() {
            *end = Some(create()?);
        }
        Ok(())
    }
}

/// A service that its opener holds. Its last holder removes its files by their names: where these lead to another service by now, made in
/// the place of this one, it is left as it is until the program ends.
#[derive(Debug)]
pub(crate) struct Held<S> {
    /// There until the end.
    service: Option<S>,
    footing: Footing,
}

impl<S: PortFactory> Held<S> {
    pub(crate) fn new(service: S, config: &Config) -> Self {
        let footing = Footing::of(config, &marks_of(&service));
        Held { service: Some(service), footing }
    }

    pub(crate) fn get(&self) -> Option<&S> {
        self.service.as_ref()
    }
}

impl<S> Drop for Held<S> {
    fn drop(&mut self) {
        if !self.footing.is_in_place() {
            mem::forget(self.service.take());
        }
    }
}

/// What the files of a service have in their names.
pub(crate) fn marks_of(service: &impl PortFactory) -> [String; 2] {
    [service.unique_service_id().value().to_string(), service.service_hash().to_string()]
}

fn inode(file: &Path) -> io::Result<Inode> {
    let found = fs::symlink_metadata(file)?;
    Ok((found.dev(), found.ino()))
}
