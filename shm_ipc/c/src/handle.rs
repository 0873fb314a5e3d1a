//! Handles: what C programs hold instead of our memory.
//!
//! A handle looks like a pointer and is a number that no other handle of the process has or will have. Nobody follows it: it is looked up.
//! So one that was closed, closed twice, or never given out is not found, whatever else was opened meanwhile.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::Failure;

/// The next handle of any kind. A process that opened a thousand a second would take half a billion years to use them up.
static NEXT: AtomicUsize = AtomicUsize::new(1);

/// What the handles of one kind stand for. `H` is the type that C sees a pointer to.
pub(crate) struct Table<T> {
    /// What it holds, in the words of an error.
    kind: &'static str,
    live: Mutex<BTreeMap<usize, Arc<T>>>,
}

impl<T> Table<T> {
    pub(crate) const fn new(kind: &'static str) -> Self {
        Table { kind, live: Mutex::new(BTreeMap::new()) }
    }

    /// Keeps a value, and returns its handle.
    pub(crate) fn insert<H>(&self, value: T) -> *mut H {
        // Relaxed: a number of its own is all that is wanted; the mutex orders what it stands for.
        let handle = NEXT.fetch_add(1, Ordering::Relaxed);
        self.live().insert(handle, Arc::new(value));
        std::ptr::without_provenance_mut(handle)
    }

    /// What a handle stands for. It stays as long as the caller needs it, whoever closes the handle meanwhile.
    pub(crate) fn get<H>(&self, handle: *const H) -> Result<Arc<T>, Failure> {
        let found = self.live().get(&handle.addr()).map(Arc::clone);
        found.ok_or_else(|| self.unknown(handle))
    }

    /// Takes a value out: its handle is not known any more.
    pub(crate) fn remove<H>(&self, handle: *const H) -> Result<Arc<T>, Failure> {
        let found = self.live().remove(&handle.addr());
        found.ok_or_else(|| self.unknown(handle))
    }

    #[cold]
    fn unknown<H>(&self, handle: *const H) -> Failure {
        match handle.addr() {
            0 => Failure::null(self.kind),
            number => Failure::handle(self.kind, number),
        }
    }

    /// A panic leaves the map as it is: it is only looked up and changed by one call each.
    fn live(&self) -> MutexGuard<'_, BTreeMap<usize, Arc<T>>> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    enum Kind {}

    #[test]
    fn a_handle_that_was_closed_is_never_another_s() {
        let table: Table<u32> = Table::new("a number");
        let first: *mut Kind = table.insert(1);
        assert_eq!(*table.remove(first).unwrap(), 1);
        let second: *mut Kind = table.insert(2);
        assert_ne!(first, second);
        let text = table.remove(first).unwrap_err().to_string();
        assert!(text.contains(&format!("{} is not a number", first.addr())), "{text}");
        assert_eq!(*table.get(second).unwrap(), 2);
    }

    #[test]
    fn null_is_told_apart() {
        let table: Table<u32> = Table::new("a number");
        let text = table.get::<Kind>(std::ptr::null()).unwrap_err().to_string();
        assert!(text.contains("NULL"), "{text}");
    }

    #[test]
    fn what_one_thread_uses_outlives_its_handle() {
        let table: Table<u32> = Table::new("a number");
        let handle: *mut Kind = table.insert(7);
        let used = table.get(handle).unwrap();
        table.remove(handle).unwrap();
        assert_eq!(*used, 7);
    }
}
