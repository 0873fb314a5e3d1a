//! A PNG file, read as a mask, as a picture, and for its texts.
#![no_main]
#![allow(clippy::unwrap_used)]

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use uvcam_fuzz::{MemoryFile, chunks, message};
use uvcam_masker::check::check;
use uvcam_masker::{GrayImage, ImageView, ImageViewMut, Mask, file};

/// Pixels up to which a mask is tried pixel by pixel: more take longer and show the same.
const TRIED_PX: usize = 1 << 16;

/// What frames hold before the mask is applied.
const LIT: u8 = 0xa5;

thread_local!(static FILE: MemoryFile = MemoryFile::new());

fuzz_mutator!(|png: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let changed = match seed % 4 {
        0 => None,
        _ => chunks::change_one(&mut png[..max_size], size, seed / 4, fuzzer_mutate),
    };
    changed.unwrap_or_else(|| fuzzer_mutate(png, size, max_size))
});

fuzz_target!(|png: &[u8]| {
    FILE.with(|file| {
        let path = file.fill(&chunks::with_check_sums(png));
        if let Err(error) = file::read_texts(path) {
            message(&error);
        }
        let gray = match file::read_gray(path) {
            Ok(gray) => gray,
            Err(error) => return assert!(message(&error).contains("/proc/"), "{error}: names no file"),
        };
        assert!(!check(&gray, None).can_fly() || Mask::from_gray(&gray).is_ok(), "cannot fly as it can");
        match Mask::load(path) {
            Ok(mask) => {
                assert_eq!(mask, Mask::from_gray(&gray).unwrap());
                [1, 2].into_iter().for_each(|bytes| blank(&mask, &gray, bytes));
            }
            Err(error) => assert!(message(&error).contains("/proc/"), "{error}: names no file"),
        }
    });
});

/// Applied to a frame with padding, the mask blanks its pixels and touches nothing else.
fn blank(mask: &Mask, gray: &GrayImage, bytes_per_pixel: usize) {
    if gray.len() > TRIED_PX {
        return;
    }
    let (width, height) = gray.dimensions();
    let row = width as usize * bytes_per_pixel;
    let stride = row + 3;
    let mut frame = vec![LIT; stride * height as usize];
    let mut view = ImageViewMut::new(&mut frame, width, height, stride, bytes_per_pixel).unwrap();
    mask.apply(&mut view).unwrap();
    let view = ImageView::new(&frame, width, height, stride, bytes_per_pixel).unwrap();
    assert_eq!(mask.masked_nonzero(&view), Ok(0));
    for (bytes, values) in frame.chunks_exact(stride).zip(gray.as_raw().chunks_exact(width as usize)) {
        let (pixels, padding) = bytes.split_at(row);
        for (pixel, value) in pixels.chunks_exact(bytes_per_pixel).zip(values) {
            assert!(pixel.iter().all(|byte| *byte == if *value == 0 { 0 } else { LIT }));
        }
        assert!(padding.iter().all(|byte| *byte == LIT));
    }
}
