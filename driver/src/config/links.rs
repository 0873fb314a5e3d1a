//! Where a path leads.

use std::path::{Component, Path, PathBuf};

/// The path from `/` on, with links followed as far as it exists, and without detours.
pub(super) fn resolved(path: &Path) -> PathBuf {
    without_links(&std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()))
}

fn without_links(path: &Path) -> PathBuf {
    if let Ok(path) = path.canonicalize() {
        return path;
    }
    match (path.components().next_back(), path.parent()) {
        (Some(Component::Normal(name)), Some(folder)) => without_links(folder).join(name),
        (Some(Component::ParentDir), Some(folder)) => {
            let folder = without_links(folder);
            folder.parent().map_or(folder.clone(), Path::to_path_buf)
        }
        _ => path.to_path_buf(),
    }
}
