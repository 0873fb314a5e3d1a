//! The mask in force, beside the frames: for perception that must not take the edge of a black area for something, and for cameras whose
//! frames are not blanked.
//!
//! The service `uvcam/v2/<camera>/mask` is publish-subscribe of bytes with a history of one. The driver sends a mask before the first frame
//! that names it, and gives the newest to consumers that come later. A camera that flies without a mask has no such service. A sample is a
//! header of 64 bytes and, behind it, little-endian:
//!
//! | bytes | what |
//! | --- | --- |
//! | `width * height` | the image, row by row without padding: 0 discard, 255 keep |
//! | up to 3 | zeros, to a multiple of 4 |
//! | `12 * runs` | the masked runs in row order, from left to right: row, first column, length, each 4 bytes |
//! | `provenance_bytes` | where the mask comes from: a JSON object of texts, UTF-8 |
//!
//! Laws of a received mask:
//! 1. Header, runs and provenance are copied once, and only the copies are checked and believed. The image alone is read where it lies.
//! 2. A driver does not write a slot that it has sent until every consumer has dropped it. One that breaks this can change pixels under a
//!    reader's eyes, never sizes.

use std::mem::{offset_of, size_of};
use std::sync::{Arc, Mutex, PoisonError};

use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::sample::Sample;

use crate::header::{CONTRACT_VERSION, FrameHeader, LARGEST_SIDE};
use crate::quirks::{Ipc, Received};

mod publisher;
mod reader;

pub use publisher::{MaskPublisher, NewMask, mask_service_name};
pub(crate) use reader::MaskReader;

/// "UVCK" in memory: the first four bytes of every mask.
const MAGIC: u32 = u32::from_le_bytes(*b"UVCK");
/// Value of a masked pixel.
const DISCARD: u8 = 0;
/// Value of any other pixel.
const KEEP: u8 = 255;
/// Longest text of a mask's provenance, bytes.
pub const LONGEST_PROVENANCE: usize = 16 * 1024;
/// Bytes of a run.
const RUN_BYTES: usize = 12;
/// Grown images that a mask keeps.
const GROWN: usize = 4;

/// What a mask begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("uvcam::MaskHeader")]
pub(crate) struct MaskHeader {
    pub(crate) magic: u32,
    pub(crate) contract_version: u16,
    pub(crate) header_size: u16,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) mask_id: [u8; 16],
    pub(crate) masked_px: u64,
    pub(crate) runs: u32,
    pub(crate) provenance_bytes: u32,
    pub(crate) reserved: [u64; 2],
}

macro_rules! assert_offsets {
    ($($field:ident: $offset:literal),+ $(,)?) => {
        $(const _: () = assert!(offset_of!(MaskHeader, $field) == $offset);)+
    };
}

assert_offsets! {
    magic: 0, contract_version: 4, header_size: 6, width: 8, height: 12, mask_id: 16, masked_px: 32, runs: 40, provenance_bytes: 44,
    reserved: 48,
}
const _: () = assert!(size_of::<MaskHeader>() == 64);

/// Horizontal run of masked pixels: columns `start` to `start + length - 1` of row `row`, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Run {
    /// Row, downwards from the top.
    pub row: u32,
    /// First masked column.
    pub start: u32,
    /// Masked pixels, at least 1.
    pub length: u32,
}

/// A mask that frames name, in the memory that the driver wrote. Copies are cheap, and share it.
///
/// A consumer may hold eight masks of a camera, four of which its [`Subscriber`](crate::Subscriber) keeps; a slot goes back to the driver
/// when the last copy is dropped.
#[derive(Debug, Clone)]
pub struct Mask(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    received: Received<MaskHeader>,
    header: MaskHeader,
    runs: Vec<Run>,
    provenance: String,
    /// By how many pixels, and the image.
    grown: Mutex<Vec<(u32, Arc<[u8]>)>>,
}

impl Mask {
    /// Checks a mask; `None` where it is not to be trusted.
    fn received(sample: Sample<Ipc, [u8], MaskHeader>) -> Option<Mask> {
        let received = Received::new(sample);
        // Law 1.
        let header = *received.header();
        let (runs, provenance) = header.read(received.payload())?;
        Some(Mask(Arc::new(Shared { received, header, runs, provenance, grown: Mutex::default() })))
    }

    /// Identity: the [`FrameHeader::mask_id`](crate::FrameHeader::mask_id) of its frames. The first 16 bytes of the SHA-256 of the mask as a
    /// binary PGM file, `P5\n{width} {height}\n255\n` and [`Mask::pixels`].
    pub fn id(&self) -> [u8; 16] {
        self.0.header.mask_id
    }

    /// Pixels in a row, as many as in a frame.
    pub fn width(&self) -> u32 {
        self.0.header.width
    }

    /// Rows, as many as in a frame.
    pub fn height(&self) -> u32 {
        self.0.header.height
    }

    /// The image, row by row from the top without padding, one byte a pixel: 0 discard, 255 keep. The driver's own memory.
    pub fn pixels(&self) -> &[u8] {
        self.0.received.payload().get(..self.0.header.image_bytes()).unwrap_or_default()
    }

    /// The masked runs in row order, from left to right.
    pub fn runs(&self) -> &[Run] {
        &self.0.runs
    }

    /// Masked pixels.
    pub fn masked_px(&self) -> u64 {
        self.0.header.masked_px
    }

    /// Where the mask comes from: a JSON object of texts, such as camera, method and time of a generated one; `{}` where nothing is known.
    /// At most [`LONGEST_PROVENANCE`] bytes.
    pub fn provenance(&self) -> &str {
        &self.0.provenance
    }

    /// A copy of the image in which the masked areas reach `pixels` further to each side, by columns and rows, so that what looks around a
    /// pixel by no more than that does not see the edge of a black area. Kept, so that it costs something once.
    pub fn grown(&self, pixels: u32) -> Arc<[u8]> {
        let mut kept = self.0.grown.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, image)) = kept.iter().find(|(by, _)| *by == pixels) {
            return image.clone();
        }
        let image: Arc<[u8]> = grow(&self.0.header, self.runs(), pixels).into();
        if kept.len() == GROWN {
            kept.remove(0);
        }
        kept.push((pixels, image.clone()));
        image
    }

    /// Whether this is the mask that a frame names.
    fn is_of(&self, frame: &FrameHeader) -> bool {
        let MaskHeader { width, height, mask_id, .. } = self.0.header;
        (mask_id, width, height) == (frame.mask_id, frame.width, frame.height)
    }
}

impl MaskHeader {
    fn image_bytes(&self) -> usize {
        self.width as usize * self.height as usize
    }

    fn runs_at(&self) -> usize {
        self.image_bytes().next_multiple_of(4)
    }

    fn provenance_at(&self) -> usize {
        self.runs_at() + self.runs as usize * RUN_BYTES
    }

    /// Bytes behind the header. No overflow in 64 bits: sides have 16 bits, counts 32.
    fn payload_bytes(&self) -> usize {
        self.provenance_at() + self.provenance_bytes as usize
    }

    /// What lies behind the image, checked; `None` where it is not to be trusted. To be called on a copy.
    fn read(&self, payload: &[u8]) -> Option<(Vec<Run>, String)> {
        let is_ours = self.magic == MAGIC
            && self.contract_version == CONTRACT_VERSION
            && usize::from(self.header_size) == size_of::<MaskHeader>()
            && is_size(self.width, self.height)
            && self.provenance_bytes as usize <= LONGEST_PROVENANCE
            && self.payload_bytes() <= payload.len();
        if !is_ours {
            return None;
        }
        let number = |bytes: &[u8]| bytes.try_into().map(u32::from_le_bytes).unwrap_or_default();
        let runs = payload.get(self.runs_at()..self.provenance_at())?.chunks_exact(RUN_BYTES);
        let runs: Vec<Run> = runs
            .map(|run| {
                let mut numbers = run.chunks_exact(4).map(number);
                let mut next = || numbers.next().unwrap_or_default();
                Run { row: next(), start: next(), length: next() }
            })
            .collect();
        if !are_sound(&runs, self.width, self.height) || masked_px(&runs) != self.masked_px {
            return None;
        }
        let provenance = payload.get(self.provenance_at()..self.payload_bytes())?.to_vec();
        Some((runs, String::from_utf8(provenance).ok()?))
    }
}

fn is_size(width: u32, height: u32) -> bool {
    let sane = 1..=LARGEST_SIDE;
    sane.contains(&width) && sane.contains(&height)
}

/// Whether runs lie in an image of this size, in their order, and touch nowhere.
fn are_sound(runs: &[Run], width: u32, height: u32) -> bool {
    let end = |run: &Run| u64::from(run.start) + u64::from(run.length);
    let is_inside = |run: &Run| run.row < height && run.length > 0 && end(run) <= width.into();
    let mut last = None;
    runs.iter()
        .all(|run| is_inside(run) && last.replace((run.row, end(run))) < Some((run.row, run.start.into())))
}

fn masked_px(runs: &[Run]) -> u64 {
    runs.iter().map(|run| u64::from(run.length)).sum()
}

/// The image of these runs, each side of them `by` pixels further out.
fn grow(header: &MaskHeader, runs: &[Run], by: u32) -> Vec<u8> {
    let (width, by_columns) = (header.width as usize, by as usize);
    let mut wide = vec![KEEP; header.image_bytes()];
    for run in runs {
        let begin = (run.start as usize).saturating_sub(by_columns);
        let end = (run.start as usize + run.length as usize).saturating_add(by_columns).min(width);
        let row = run.row as usize * width;
        if let Some(pixels) = wide.get_mut(row + begin..row + end) {
            pixels.fill(DISCARD);
        }
    }
    let mut image = wide.clone();
    // Down, and up: a column stays masked for as many rows behind each masked one.
    fn sweep<'a>(by: u32, width: usize, rows: impl Iterator<Item = (&'a mut [u8], &'a [u8])>) {
        let mut left = vec![0; width];
        for (to, from) in rows {
            for ((to, from), left) in to.iter_mut().zip(from).zip(&mut left) {
                if *from == DISCARD {
                    *left = by;
                } else if *left > 0 {
                    *left -= 1;
                    *to = DISCARD;
                }
            }
        }
    }
    sweep(by, width, image.chunks_exact_mut(width).zip(wide.chunks_exact(width)));
    sweep(by, width, image.chunks_exact_mut(width).zip(wide.chunks_exact(width)).rev());
    image
}

#[cfg(test)]
mod tests;
