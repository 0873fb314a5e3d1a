//! Taking all memory of a publisher at once, before the first frame.
//!
//! The memory of a segment is taken page by page when it is first written: 0.4 to 2 ms a frame, and a fatal signal (SIGBUS) where
//! `/dev/shm` is full by then. Asked for all of it, the kernel takes the time now, and answers with an error instead.
//!
//! Law 1: `MADV_POPULATE_WRITE` changes no byte of a page; on a mapping of this process it can only make pages present.

use std::ops::Range;

use rustix::io::Errno;
use rustix::mm::{Advice, madvise};

use crate::quirks::SHARED_MEMORY;

/// Longest file whose memory is taken because it is small, bytes.
const SMALL: usize = 1 << 20;

/// Makes every page of the mapping that holds `address` present.
///
/// Does nothing where the kernel is older than 5.14, which does not know how.
pub(crate) fn make_present(address: usize) -> Result<(), std::io::Error> {
    let Some(mapping) = mapping_of(address)? else { return Ok(()) };
    Ok(populate(&mapping)?)
}

/// Makes every page of this process's small files in `/dev/shm` present: registers, queues and records, of which iceoryx2 writes some pages
/// only when it first uses them. Those of frames and answers are taken by who uses them.
pub(crate) fn make_small_files_present(prefix: &str) -> Result<(), std::io::Error> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let start = format!("{SHARED_MEMORY}/{prefix}");
    let small = maps.lines().filter_map(|line| {
        let mut fields = line.split_whitespace();
        let mapping = range(fields.next()?)?;
        let is_writable = fields.next()?.contains('w');
        let is_ours = fields.nth(3).is_some_and(|path| path.starts_with(&start));
        (is_writable && is_ours && mapping.len() <= SMALL).then_some(mapping)
    });
    small.into_iter().try_for_each(|mapping| match populate(&mapping) {
        // Another thread has just closed it.
        Err(Errno::NOMEM) => Ok(()),
        outcome => Ok(outcome?),
    })
}

fn populate(mapping: &Range<usize>) -> Result<(), Errno> {
    let start = std::ptr::with_exposed_provenance_mut(mapping.start);
    // SAFETY: law 1; the range is a mapping of this process, as the kernel itself lists it.
    match unsafe { madvise(start, mapping.len(), Advice::LinuxPopulateWrite) } {
        Err(Errno::INVAL) => Ok(()),
        outcome => outcome,
    }
}

/// The mapping that holds `address`, from `/proc/self/maps` (proc_pid_maps(5)).
fn mapping_of(address: usize) -> Result<Option<Range<usize>>, std::io::Error> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let mut mappings = maps.lines().filter_map(|line| range(line.split_whitespace().next()?));
    Ok(mappings.find(|mapping| mapping.contains(&address)))
}

/// The addresses of a line of it.
fn range(addresses: &str) -> Option<Range<usize>> {
    let (start, end) = addresses.split_once('-')?;
    Some(usize::from_str_radix(start, 16).ok()?..usize::from_str_radix(end, 16).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_mapping_of_a_value_and_none_where_nothing_is() {
        let value = Box::new(7);
        let address = std::ptr::from_ref(&*value).addr();
        assert!(mapping_of(address).unwrap().unwrap().contains(&address));
        assert_eq!(mapping_of(8).unwrap(), None);
        make_present(address).unwrap();
        assert_eq!(*value, 7);
    }
}
