//! A mask in a program's hands.

use std::ffi::c_char;
use std::mem::{offset_of, size_of};
use std::sync::Arc;

use uvcam_shm_ipc::Mask;
use uvcam_shm_ipc::mask::Run;

use crate::argument;
use crate::error::{UVCAM_NONE, UVCAM_OK, call, uvcam_status};
use crate::frame::{FRAMES, uvcam_frame};
use crate::handle::Table;
use crate::subscriber::{self, uvcam_subscriber};

/// A mask that this program holds, until uvcam_mask_release(). It may be used by any thread, and outlives its frame and its subscriber.
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_mask(());

/// Horizontal run of masked pixels: columns `start` to `start + length - 1` of row `row`, counted from 0.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_run {
    /// Row, downwards from the top.
    pub row: u32,
    /// First masked column.
    pub start: u32,
    /// Masked pixels, at least 1.
    pub length: u32,
}

const _: () = assert!(size_of::<uvcam_run>() == size_of::<Run>());
const _: () = assert!(offset_of!(uvcam_run, row) == offset_of!(Run, row));
const _: () = assert!(offset_of!(uvcam_run, start) == offset_of!(Run, start));
const _: () = assert!(offset_of!(uvcam_run, length) == offset_of!(Run, length));

/// What there is to see of a mask. All of it is valid until the mask is released.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "its name in C")]
pub struct uvcam_mask_view {
    /// Identity: the `mask_id` of its frames.
    pub mask_id: [u8; 16],
    /// Pixels in a row, as many as in a frame.
    pub width: u32,
    /// Rows, as many as in a frame.
    pub height: u32,
    /// The image, row by row from the top without padding, one byte a pixel: 0 discard, 255 keep. Grown where that was asked for; else the
    /// driver's own memory, mapped for reading alone.
    pub pixels: *const u8,
    /// Bytes of the image: width * height.
    pub size: usize,
    /// The masked runs in row order, from left to right, not grown.
    pub runs: *const uvcam_run,
    /// How many.
    pub run_count: usize,
    /// Masked pixels, not grown.
    pub masked_px: u64,
    /// Where the mask comes from: a JSON object of texts. No zero byte ends it.
    pub provenance: *const c_char,
    /// Bytes of it.
    pub provenance_size: usize,
}

struct Held {
    mask: Mask,
    /// Where more is masked than the driver masks.
    grown: Option<Arc<[u8]>>,
}

static MASKS: Table<Held> = Table::new("a mask");

/// Gives the mask of a frame, whichever is in force by now: UVCAM_OK, or UVCAM_NONE where its camera flies without one. Never waits, and
/// costs little while the mask stays the same. `mask` becomes NULL where there is none, and is to be released where there is one.
///
/// With `grown_by` above 0, masked areas reach as many pixels further to each side, by columns and rows, so that what looks around a pixel
/// by no more than that does not see the edge of a black area.
///
/// UVCAM_ERROR_MASK_PENDING where the mask has not come yet, for a second or two after the first call and after the driver started anew: go
/// on with the next frame.
///
/// # Safety
/// Law 3 for `mask`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_frame_mask(
    subscriber: *mut uvcam_subscriber,
    frame: *const uvcam_frame,
    grown_by: u32,
    mask: *mut *mut uvcam_mask,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(mask, "a place for a mask") }?;
        let place = place.write(std::ptr::null_mut());
        let frame = FRAMES.get(frame)?;
        let Some(mask) = subscriber::using(subscriber, |subscriber| Ok(subscriber.mask_of(&frame)?))? else {
            return Ok(UVCAM_NONE);
        };
        let grown = (grown_by > 0).then(|| mask.grown(grown_by));
        *place = MASKS.insert(Held { mask, grown });
        Ok(UVCAM_OK)
    })
}

/// Shows a mask.
///
/// # Safety
/// Law 3 for `view`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn uvcam_mask_read(
    mask: *const uvcam_mask,
    view: *mut uvcam_mask_view,
) -> uvcam_status {
    call(|| {
        // SAFETY: law 3.
        let place = unsafe { argument::place(view, "a place for a view") }?;
        // What is shown is the table's until the mask is released.
        let held = MASKS.get(mask)?;
        let pixels = held.grown.as_deref().unwrap_or(held.mask.pixels());
        place.write(uvcam_mask_view {
            mask_id: held.mask.id(),
            width: held.mask.width(),
            height: held.mask.height(),
            pixels: pixels.as_ptr(),
            size: pixels.len(),
            runs: held.mask.runs().as_ptr().cast(),
            run_count: held.mask.runs().len(),
            masked_px: held.mask.masked_px(),
            provenance: held.mask.provenance().as_ptr().cast(),
            provenance_size: held.mask.provenance().len(),
        });
        Ok(UVCAM_OK)
    })
}

/// Gives a mask's memory back to the driver. What was seen of it is not to be touched any more, by any thread.
#[unsafe(no_mangle)]
pub extern "C" fn uvcam_mask_release(mask: *mut uvcam_mask) -> uvcam_status {
    call(|| MASKS.remove(mask).map(|_| UVCAM_OK))
}
