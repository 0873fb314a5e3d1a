//! What a person sees is what flies: no transparent pixel, no turned picture, no 12 bits in 16.
#![allow(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

mod raw_png;

use std::error::Error as _;
use std::path::{Path, PathBuf};

use raw_png::{RawPng, exif};
use tempfile::TempDir;
use uvcam_masker::Mask;
use uvcam_masker::file::{FileError, FrameError, mask_image, read_frame, read_gray, read_mask};
use uvcam_masker::mask::MaskError;

const PALETTE: [u8; 6] = [0, 0, 0, 255, 255, 255];

fn refusal(png: &RawPng) -> MaskError {
    match mask_image(Path::new("mask.png"), &png.bytes(), None).unwrap_err() {
        FileError::NotAMask { source, .. } => source,
        other => panic!("{other}"),
    }
}

fn file(png: &RawPng) -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("image.png");
    std::fs::write(&path, png.bytes()).unwrap();
    (folder, path)
}

/// Masks of 4 x 1 pixels, black and white in turn, of which the second alone is transparent, by a little where that is possible.
fn transparent() -> Vec<(&'static str, RawPng)> {
    let grey = |depth, pixels: &[u8]| RawPng::new((4, 1), 0, depth, pixels);
    vec![
        ("grey and alpha, 8 bits", RawPng::new((4, 1), 4, 8, &[0, 255, 255, 254, 0, 255, 255, 255])),
        (
            "grey and alpha, 16 bits, the lower byte alone",
            RawPng::new(
                (4, 1),
                4,
                16,
                &[[0, 0, 255, 255], [255, 255, 255, 254], [0, 0, 255, 255], [255; 4]].concat(),
            ),
        ),
        (
            "colour and alpha, 8 bits",
            RawPng::new(
                (4, 1),
                6,
                8,
                &[[0, 0, 0, 255], [255, 255, 255, 0], [0, 0, 0, 255], [255; 4]].concat(),
            ),
        ),
        (
            "colour and alpha, 16 bits, the lower byte alone",
            RawPng::new(
                (4, 1),
                6,
                16,
                &[
                    [0, 0, 0, 0, 0, 0, 255, 255],
                    [255, 255, 255, 255, 255, 255, 255, 254],
                    [0, 0, 0, 0, 0, 0, 255, 255],
                    [255; 8],
                ]
                .concat(),
            ),
        ),
        ("grey of 1 bit, one made transparent", grey(1, &[0b0100_0000]).with(b"tRNS", &[0, 1])),
        ("grey of 2 bits", grey(2, &[0b00_11_00_00]).with(b"tRNS", &[0, 3])),
        ("grey of 4 bits", grey(4, &[0x0f, 0]).with(b"tRNS", &[0, 15])),
        ("grey of 8 bits", grey(8, &[0, 255, 0, 0]).with(b"tRNS", &[0, 255])),
        ("grey of 16 bits", grey(16, &[0, 0, 255, 255, 0, 0, 0, 0]).with(b"tRNS", &[255, 255])),
        (
            "colour of 8 bits",
            RawPng::new((4, 1), 2, 8, &[[0; 3], [255; 3], [0; 3], [0; 3]].concat())
                .with(b"tRNS", &[0, 255, 0, 255, 0, 255]),
        ),
        (
            "colour of 16 bits",
            RawPng::new((4, 1), 2, 16, &[[0; 6], [255; 6], [0; 6], [0; 6]].concat()).with(b"tRNS", &[255; 6]),
        ),
        (
            "palette of 1 bit",
            RawPng::new((4, 1), 3, 1, &[0b0100_0000]).with(b"PLTE", &PALETTE).with(b"tRNS", &[255, 254]),
        ),
        (
            "palette of 8 bits",
            RawPng::new((4, 1), 3, 8, &[0, 1, 0, 0]).with(b"PLTE", &PALETTE).with(b"tRNS", &[255, 0]),
        ),
    ]
}

#[test]
fn a_transparent_pixel_of_any_kind_is_refused_with_their_number() {
    for (name, png) in transparent() {
        assert_eq!(refusal(&png), MaskError::Transparent { transparent_px: 1 }, "{name}");
    }
    let (_folder, path) = file(&transparent()[0].1);
    let error = Mask::load(&path).unwrap_err();
    assert_eq!(
        error.source().unwrap().to_string(),
        "1 transparent pixels; flatten the picture: black is discarded, white kept"
    );
}

#[test]
fn an_alpha_channel_that_is_opaque_everywhere_is_none() {
    let opaque = [
        RawPng::new((2, 1), 4, 8, &[0, 255, 255, 255]),
        RawPng::new((2, 1), 4, 16, &[0, 0, 255, 255, 255, 255, 255, 255]),
        RawPng::new((2, 1), 6, 8, &[0, 0, 0, 255, 255, 255, 255, 255]),
        RawPng::new((2, 1), 6, 16, &[[0, 0, 0, 0, 0, 0, 255, 255], [255; 8]].concat()),
        RawPng::new((2, 1), 3, 8, &[0, 1]).with(b"PLTE", &PALETTE).with(b"tRNS", &[255]),
        // Transparent entries that no pixel uses.
        RawPng::new((2, 1), 3, 8, &[0, 1])
            .with(b"PLTE", &[PALETTE, [9; 6]].concat())
            .with(b"tRNS", &[255, 255, 0, 7]),
        RawPng::new((2, 1), 0, 8, &[0, 255]).with(b"tRNS", &[0, 7]),
    ];
    for png in opaque {
        let gray = mask_image(Path::new("mask.png"), &png.bytes(), None).unwrap();
        assert_eq!(gray.into_raw(), [0, 255]);
    }
}

#[test]
fn interlaced_images_are_read_as_the_others() {
    let pixels: Vec<u8> =
        (0..11 * 9).flat_map(|n: u32| [(n * 37) as u8, (n * 91) as u8, (n * 53) as u8]).collect();
    let [plain, interlaced] =
        [RawPng::new((11, 9), 2, 8, &pixels), RawPng::interlaced((11, 9), 2, 8, &pixels)].map(|png| {
            let (_folder, path) = file(&png);
            read_gray(&path).unwrap()
        });
    assert_eq!(plain, interlaced);
    let hole = RawPng::interlaced((3, 3), 4, 8, &[[255; 10].as_slice(), &[255, 3], &[255; 6]].concat());
    assert_eq!(refusal(&hole), MaskError::Transparent { transparent_px: 1 });
}

#[test]
fn no_damaged_bit_makes_a_transparent_pixel_opaque() {
    for (name, png) in transparent() {
        let bytes = png.bytes();
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(mask_image(Path::new("mask.png"), &damaged, None).is_err(), "{name}, bit {bit}");
        }
    }
}

#[test]
fn a_picture_that_is_shown_turned_is_refused() {
    let mask = || RawPng::new((2, 1), 0, 8, &[0, 255]);
    for orientation in 2..=8 {
        let expected = MaskError::Turned { orientation: orientation as u8 };
        assert_eq!(refusal(&mask().with(b"eXIf", &exif(orientation))), expected);
        assert_eq!(refusal(&mask().with_after(b"eXIf", &exif(orientation))), expected);
    }
    assert!(
        refusal(&mask().with(b"eXIf", &exif(6)))
            .to_string()
            .starts_with("EXIF orientation 6; save the mask upright")
    );
    for upright in [exif(1), b"II*\0".to_vec(), b"MM".to_vec(), Vec::new()] {
        assert!(mask_image(Path::new("mask.png"), &mask().with(b"eXIf", &upright).bytes(), None).is_ok());
    }
}

#[test]
fn frames_are_opaque_and_upright_as_well() {
    let refusal = |png: &RawPng| {
        let (_folder, path) = file(png);
        match read_frame(&path) {
            Err(FileError::NotAFrame { source, .. }) => source,
            other => panic!("{other:?}"),
        }
    };
    for (name, png) in transparent() {
        assert_eq!(refusal(&png), FrameError::Transparent { transparent_px: 1 }, "{name}");
    }
    let turned = refusal(&RawPng::new((2, 1), 0, 8, &[0, 9]).with(b"eXIf", &exif(3)));
    assert_eq!(turned, FrameError::Turned { orientation: 3 });
    let message =
        "EXIF orientation 3; use the frame as the camera gave it, or save it upright (orientation 1)";
    assert_eq!(turned.to_string(), message);
    let message = "7 transparent pixels; use the frame as the camera gave it, without transparency";
    assert_eq!(FrameError::Transparent { transparent_px: 7 }.to_string(), message);
}

#[test]
fn twelve_bits_in_sixteen_are_told_from_sixteen() {
    let wide = |samples: &[u16]| {
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_be_bytes()).collect();
        let (_folder, path) = file(&RawPng::new((samples.len() as u32, 1), 0, 16, &bytes));
        read_frame(&path).unwrap().unscaled_bits()
    };
    assert_eq!(wide(&[0, 4095, 17]), Some(12));
    assert_eq!(wide(&[1023, 512]), Some(10));
    assert_eq!(wide(&[4096, 0]), None, "13 bits");
    assert_eq!(wide(&[0, 0]), Some(0), "a black frame has no bits to tell from");
    let (_folder, path) = file(&RawPng::new((2, 1), 0, 8, &[1, 2]));
    assert_eq!(read_frame(&path).unwrap().unscaled_bits(), None);
    // Alpha is no sample to tell from.
    let (_folder, path) = file(&RawPng::new((1, 1), 6, 16, &[0, 9, 15, 255, 0, 9, 255, 255]));
    assert_eq!(read_frame(&path).unwrap().unscaled_bits(), Some(12));
    let message = "these pictures use 12 of 16 bits; scale them to all 16, or save them with 8";
    assert_eq!(FrameError::Unscaled { used_bits: 12 }.to_string(), message);
}

#[test]
fn another_size_is_refused_before_anything_is_decoded() {
    let mut png = RawPng::new((4, 2), 0, 8, &[0; 8]);
    png.0[1].1.clear();
    let error = mask_image(Path::new("mask.png"), &png.bytes(), Some((2, 4))).unwrap_err();
    assert!(
        error.source().unwrap().to_string().starts_with("the mask is 4x2 pixels, the frames are 2x4"),
        "{error:?}"
    );
    let (_folder, path) = file(&png);
    assert!(matches!(read_mask(&path, Some((4, 2))), Err(FileError::Decode { .. })));
}
