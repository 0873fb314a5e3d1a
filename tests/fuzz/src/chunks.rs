//! PNG files chunk by chunk: bytes changed blindly would end at the first check sum.

use std::ops::Range;

/// Bytes before the first chunk.
const SIGNATURE: usize = 8;
/// Bytes of a chunk's length, and of its type.
const WORD: usize = 4;

/// The file with the check sums that its chunks ought to have.
pub fn with_check_sums(png: &[u8]) -> Vec<u8> {
    let mut sound = png.to_vec();
    for data in chunks(png) {
        let sum = crc32fast::hash(&png[data.start - WORD..data.end]);
        sound[data.end..data.end + WORD].copy_from_slice(&sum.to_be_bytes());
    }
    sound
}

/// Changes the data of one of the file's chunks by `change`, which is handed the data's length and the greatest that it may have, and
/// returns the new one. Gives the new size of the file, of which the first `size` bytes were in use; `None` where it has no chunk.
pub fn change_one(
    png: &mut [u8],
    size: usize,
    seed: u32,
    change: impl FnOnce(&mut [u8], usize, usize) -> usize,
) -> Option<usize> {
    let chunks: Vec<_> = chunks(&png[..size]).collect();
    let data = chunks.get(seed as usize % chunks.len().max(1))?.clone();
    let rest = png[data.end..size].to_vec();
    let room = png.len() - rest.len();
    // libFuzzer changes nothing that may hold nothing.
    if room == data.start {
        return None;
    }
    let length = change(&mut png[data.start..room], data.len(), room - data.start);
    png[data.start - 2 * WORD..data.start - WORD].copy_from_slice(&(length as u32).to_be_bytes());
    let end = data.start + length;
    png[end..end + rest.len()].copy_from_slice(&rest);
    Some(end + rest.len())
}

/// Where the data of the chunks lies that are whole.
fn chunks(png: &[u8]) -> impl Iterator<Item = Range<usize>> {
    let mut next = SIGNATURE;
    std::iter::from_fn(move || {
        let length = png.get(next..)?.first_chunk()?;
        let start = next + 2 * WORD;
        let end = start + u32::from_be_bytes(*length) as usize;
        next = end + WORD;
        (next <= png.len()).then_some(start..end)
    })
}
