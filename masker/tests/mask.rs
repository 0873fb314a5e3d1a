//! What a mask promises: runs, identity, and blanking in place.

use proptest::prelude::*;
use uvcam_masker::mask::MaskError;
use uvcam_masker::{GrayImage, ImageView, ImageViewMut, Mask, MaskId, Run};

/// An image of up to 24x24 pixels that are 0 or 255.
fn binary_image() -> impl Strategy<Value = GrayImage> {
    (1_u32..24, 1_u32..24).prop_flat_map(|(width, height)| {
        prop::collection::vec(prop::bool::weighted(0.7), (width * height) as usize).prop_map(move |kept| {
            let kept = |x, y| kept[(y * width + x) as usize];
            GrayImage::from_fn(width, height, |x, y| [if kept(x, y) { 255 } else { 0 }].into())
        })
    })
}

/// A frame for a mask of `width` x `height` pixels: stride, bytes per pixel and random bytes, spare ones
/// included.
fn frame(width: u32, height: u32) -> impl Strategy<Value = (usize, usize, Vec<u8>)> {
    (0_usize..9, 1_usize..3, 0_usize..5).prop_flat_map(move |(padding, bytes_per_pixel, spare)| {
        let stride = width as usize * bytes_per_pixel + padding;
        let length = stride * height as usize - padding + spare;
        (Just(stride), Just(bytes_per_pixel), prop::collection::vec(any::<u8>(), length))
    })
}

#[test]
fn runs_name_the_masked_pixels() {
    let gray = GrayImage::from_raw(4, 3, vec![255, 0, 0, 255, 255, 255, 255, 0, 0, 255, 255, 0]).unwrap();
    let mask = Mask::from_gray(&gray).unwrap();
    let run = |row, start, length| Run { row, start, length };
    assert_eq!(mask.runs(), [run(0, 1, 2), run(1, 3, 1), run(2, 0, 1), run(2, 3, 1)]);
    assert_eq!(mask.masked_px(), 5);
}

#[test]
fn grey_pixels_are_named() {
    let gray = GrayImage::from_raw(3, 2, vec![255, 0, 255, 0, 7, 254]).unwrap();
    let error = Mask::from_gray(&gray).unwrap_err();
    assert_eq!(error, MaskError::NotBinary { grey_px: 2, x: 1, y: 1, value: 7 });
    assert_eq!(
        error.to_string(),
        "grey pixels: 2, the first at x 1, y 1 with value 7; \
         a mask has only 0 (discard) and 255 (keep): repaint it, or binarise it explicitly with `uvcam mask repair --threshold`"
    );
}

#[test]
fn binarising_keeps_the_threshold_itself() {
    let gray = GrayImage::from_raw(3, 1, vec![99, 100, 101]).unwrap();
    let mask = Mask::binarised(&gray, 100);
    assert_eq!(mask.to_gray().into_raw(), [0, 255, 255]);
}

/// `printf 'P5\n2 1\n255\n\0\377' | sha256sum | cut -c -32`
#[test]
fn identity_is_the_documented_hash() {
    let mask = Mask::from_fn(2, 1, |x, _| x == 0);
    assert_eq!(mask.id().to_string(), "6531c9c2d976d22f61c872c67005a1f4");
}

#[test]
fn masks_of_equal_area_and_other_shape_differ_in_identity() {
    assert_ne!(Mask::from_fn(4, 2, |_, _| false).id(), Mask::from_fn(2, 4, |_, _| false).id());
    assert_ne!(Mask::from_fn(2, 2, |_, _| false).id(), MaskId::NONE);
}

#[test]
fn only_32_hexadecimal_digits_are_an_identity() {
    let digits = "00112233445566778899aabbccddeeff";
    assert_eq!(digits.parse::<MaskId>().unwrap().to_string(), digits);
    assert_eq!(digits.to_uppercase().parse::<MaskId>().unwrap().to_string(), digits);
    for text in
        ["", "0011", "+0112233445566778899aabbccddeeff", &digits.replace('f', "g"), &format!("{digits}0")]
    {
        assert!(text.parse::<MaskId>().is_err(), "{text:?} was taken for an identity");
    }
}

#[test]
fn an_image_of_another_size_is_refused_and_untouched() {
    let mask = Mask::from_fn(4, 2, |_, _| true);
    let mut pixels = [7; 8];
    let error = mask.apply(&mut ImageViewMut::new(&mut pixels, 2, 4, 2, 1).unwrap()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "mask of 4x2 pixels does not fit an image of 2x4; use the mask made for this camera at this resolution"
    );
    assert_eq!(pixels, [7; 8]);
    assert!(mask.masked_nonzero(&ImageView::new(&pixels, 2, 4, 2, 1).unwrap()).is_err());
}

proptest! {
    #[test]
    fn image_and_runs_hold_the_same(gray in binary_image()) {
        let mask = Mask::from_gray(&gray).unwrap();
        for (x, y, pixel) in gray.enumerate_pixels() {
            prop_assert_eq!(mask.is_masked(x, y), pixel.0 == [0]);
        }
        prop_assert!(!mask.is_masked(mask.width(), 0) && !mask.is_masked(0, mask.height()));
        prop_assert!(mask.runs().windows(2).all(|pair| {
            (pair[0].row, pair[0].end()) < (pair[1].row, pair[1].start)
        }), "runs overlap, touch or are out of order: {:?}", mask.runs());
        prop_assert_eq!(&Mask::from_fn(mask.width(), mask.height(), |x, y| mask.is_masked(x, y)), &mask);
        prop_assert_eq!(mask.to_gray(), gray);
    }

    #[test]
    fn one_pixel_changes_the_identity(gray in binary_image(), index in any::<prop::sample::Index>()) {
        let mask = Mask::from_gray(&gray).unwrap();
        let (x, y, _) = gray.enumerate_pixels().nth(index.index(gray.len())).unwrap();
        let other = Mask::from_fn(mask.width(), mask.height(), |i, j| mask.is_masked(i, j) != ((i, j) == (x, y)));
        prop_assert_ne!(mask.id(), other.id());
        prop_assert_eq!(mask.id().to_string().parse::<MaskId>().unwrap(), mask.id());
    }

    #[test]
    fn applying_equals_and_with_the_image(
        (gray, (stride, bytes_per_pixel, frame)) in binary_image().prop_flat_map(|gray| {
            let frame = frame(gray.width(), gray.height());
            (Just(gray), frame)
        }),
    ) {
        let (width, height) = gray.dimensions();
        let mask = Mask::from_gray(&gray).unwrap();
        let mut expected = frame.clone();
        let mut nonzero = 0;
        for (x, y, pixel) in gray.enumerate_pixels() {
            let start = y as usize * stride + x as usize * bytes_per_pixel;
            let bytes = &mut expected[start..start + bytes_per_pixel];
            nonzero += u64::from(pixel.0 == [0] && bytes.iter().any(|byte| *byte != 0));
            bytes.iter_mut().for_each(|byte| *byte &= pixel.0[0]);
        }

        let view = ImageView::new(&frame, width, height, stride, bytes_per_pixel).unwrap();
        prop_assert_eq!(mask.masked_nonzero(&view).unwrap(), nonzero);
        let mut masked = frame.clone();
        mask.apply(&mut ImageViewMut::new(&mut masked, width, height, stride, bytes_per_pixel).unwrap()).unwrap();
        prop_assert_eq!(&masked, &expected);
        let view = ImageView::new(&masked, width, height, stride, bytes_per_pixel).unwrap();
        prop_assert_eq!(mask.masked_nonzero(&view).unwrap(), 0);
    }
}
