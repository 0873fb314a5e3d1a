//! PNG files in and out, the awkward ones included.
#![allow(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

use std::error::Error as _;
use std::fs;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType};
use proptest::prelude::*;
use tempfile::TempDir;
use uvcam_masker::file::{FileError, MAX_PIXELS, read_gray, read_texts, write_gray};
use uvcam_masker::{GrayImage, Mask};

/// PNG bytes of a `width` x 1 image of raw `samples`; `palette` is RGB.
fn png(width: u32, colour: ColorType, depth: BitDepth, palette: &[u8], samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, 1);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if !palette.is_empty() {
        encoder.set_palette(palette.to_vec());
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(samples).unwrap();
    writer.finish().unwrap();
    bytes
}

fn folder_with(name: &str, bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn names_in(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

fn some_mask() -> Mask {
    Mask::from_fn(31, 17, |x, y| x > 20 && y < 9)
}

#[test]
fn every_colour_type_and_depth_is_read_as_grey() {
    use BitDepth::{Eight, Four, One, Sixteen, Two};
    use ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
    let (red, green, blue) = (76, 149, 29);
    let palette = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
    let reads_as = |colour, depth, samples: &[u8], expected: [u8; 4]| {
        // Two entries are all that one bit can name.
        let entries = if depth == One { 6 } else { 12 };
        let palette = if colour == Indexed { &palette[..entries] } else { &[] };
        let (_folder, path) = folder_with("image.png", &png(4, colour, depth, palette, samples));
        assert_eq!(read_gray(&path).unwrap().into_raw(), expected, "{colour:?} at {depth:?} bits");
    };
    reads_as(Grayscale, One, &[0b0101_0000], [0, 255, 0, 255]);
    reads_as(Grayscale, Two, &[0b00_01_10_11], [0, 85, 170, 255]);
    reads_as(Grayscale, Four, &[0x01, 0xef], [0, 17, 238, 255]);
    reads_as(Grayscale, Eight, &[0, 1, 254, 255], [0, 1, 254, 255]);
    reads_as(Grayscale, Sixteen, &[0, 255, 1, 0, 0x7f, 0xff, 0xff, 0], [0, 1, 127, 255]);
    reads_as(GrayscaleAlpha, Eight, &[0, 255, 9, 0, 254, 1, 255, 0], [0, 9, 254, 255]);
    reads_as(GrayscaleAlpha, Sixteen, &[0, 0, 1, 1, 1, 1, 0, 0, 2, 2, 9, 9, 255, 255, 0, 0], [0, 1, 2, 255]);
    reads_as(Rgb, Eight, &[255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9], [red, green, blue, 9]);
    reads_as(Rgba, Eight, &[0, 0, 0, 255, 7, 7, 7, 0, 255, 0, 0, 9, 255, 255, 255, 0], [0, 7, red, 255]);
    let rgb_16 = [255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9].map(|sample| [sample, sample]);
    reads_as(Rgb, Sixteen, rgb_16.as_flattened(), [red, green, blue, 9]);
    reads_as(Indexed, One, &[0b0101_0000], [red, green, red, green]);
    reads_as(Indexed, Two, &[0b00_01_10_11], [red, green, blue, 255]);
    reads_as(Indexed, Eight, &[3, 2, 1, 0], [255, blue, green, red]);
}

#[test]
fn a_transparent_palette_entry_keeps_its_colour() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(ColorType::Indexed);
    encoder.set_palette(vec![0, 0, 0, 255, 255, 255]);
    encoder.set_trns(vec![255, 0]);
    encoder.write_header().unwrap().write_image_data(&[0, 1]).unwrap();
    let (_folder, path) = folder_with("image.png", &bytes);
    assert_eq!(read_gray(&path).unwrap().into_raw(), [0, 255]);
}

#[test]
fn what_is_written_is_8_bit_grey() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mask.png");
    some_mask().save(&path, &[]).unwrap();
    let bytes = fs::read(&path).unwrap();
    // IHDR: bit depth and colour type follow signature, chunk head, width and height.
    assert_eq!(bytes[24..26], [8, 0]);
    assert_eq!(Mask::load(&path).unwrap(), some_mask());
    assert_eq!(names_in(folder.path()), ["mask.png"]);
}

#[test]
fn texts_come_back_whatever_their_script() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mask.png");
    let texts = [
        ("Software", "uvcam".to_owned()),
        ("Author", "Žižka".to_owned()),
        ("Exposure", "2500 µs".to_owned()),
    ];
    some_mask().save(&path, &texts).unwrap();
    let mut read = read_texts(&path).unwrap();
    read.sort();
    let pair = |keyword: &str, text: &str| (keyword.to_owned(), text.to_owned());
    assert_eq!(read, [pair("Author", "Žižka"), pair("Exposure", "2500 µs"), pair("Software", "uvcam")]);
    assert_eq!(Mask::load(&path).unwrap().id(), some_mask().id());
}

#[test]
fn a_text_without_keyword_is_refused_before_anything_is_written() {
    let (folder, path) = folder_with("mask.png", b"old");
    let error = some_mask().save(&path, &[("", "text".to_owned())]).unwrap_err();
    assert!(matches!(error, FileError::Encode { .. }), "{error:?}");
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(names_in(folder.path()), ["mask.png"]);
}

#[test]
fn saving_replaces_an_older_mask() {
    let (folder, path) = folder_with("mask.png", b"old");
    some_mask().save(&path, &[]).unwrap();
    assert_eq!(Mask::load(&path).unwrap(), some_mask());
    assert_eq!(names_in(folder.path()), ["mask.png"]);
}

#[test]
fn a_name_without_folder_means_the_working_directory() {
    // An integration test runs in the folder of its package; the name is unique and is removed again.
    let file = tempfile::Builder::new().suffix(".png").tempfile_in(".").unwrap();
    let name = Path::new(file.path().file_name().unwrap());
    some_mask().save(name, &[]).unwrap();
    assert_eq!(Mask::load(name).unwrap(), some_mask());
}

#[test]
fn a_failed_rename_leaves_no_temporary_file() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mask.png");
    fs::create_dir(&path).unwrap();
    fs::write(path.join("kept"), "").unwrap();
    let error = some_mask().save(&path, &[]).unwrap_err();
    assert!(matches!(error, FileError::Write { .. }), "{error:?}");
    assert_eq!(names_in(folder.path()), ["mask.png"]);
    assert_eq!(names_in(&path), ["kept"]);
}

#[test]
fn a_missing_folder_is_named_and_not_made() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("missing/mask.png");
    let error = some_mask().save(&path, &[]).unwrap_err();
    assert!(error.to_string().contains("missing/mask.png"), "{error}");
    assert!(error.source().unwrap().to_string().contains("No such file"), "{error:?}");
    assert!(names_in(folder.path()).is_empty());
}

#[test]
fn a_folder_that_takes_no_files_is_an_error() {
    // Permission bits do not stop root; no user can make a file in /proc.
    let error = some_mask().save(Path::new("/proc/mask.png"), &[]).unwrap_err();
    assert!(matches!(error, FileError::Write { .. }), "{error:?}");
}

#[test]
fn a_missing_file_and_a_folder_cannot_be_read() {
    let folder = TempDir::new().unwrap();
    for path in [folder.path().join("missing.png"), folder.path().to_owned()] {
        let error = Mask::load(&path).unwrap_err();
        assert!(matches!(error, FileError::Read { .. }), "{error:?}");
        assert!(error.to_string().contains(path.to_str().unwrap()), "{error}");
    }
}

#[test]
fn a_huge_image_is_refused_before_it_takes_memory() {
    let mut bytes = Vec::new();
    let (width, height) = (1 << 20, 1 << 20);
    png::Encoder::new(&mut bytes, width, height).write_header().unwrap();
    let (_folder, path) = folder_with("huge.png", &bytes);
    assert!(u64::from(width) * u64::from(height) > MAX_PIXELS);
    for error in [read_gray(&path).unwrap_err(), read_texts(&path).unwrap_err()] {
        assert!(
            matches!(error, FileError::TooLarge { width: 0x10_0000, height: 0x10_0000, .. }),
            "{error:?}"
        );
    }
}

#[test]
fn a_text_that_swells_is_refused() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.add_ztxt_chunk("Comment".to_owned(), "a".repeat(8 << 20)).unwrap();
    encoder.write_header().unwrap().write_image_data(&[0]).unwrap();
    let (_folder, path) = folder_with("image.png", &bytes);
    assert!(matches!(read_texts(&path), Err(FileError::Decode { .. })));
    assert!(read_gray(&path).is_ok());
}

#[test]
fn a_photograph_is_no_mask() {
    let (_folder, path) =
        folder_with("photo.png", &png(2, ColorType::Grayscale, BitDepth::Eight, &[], &[0, 9]));
    let error = Mask::load(&path).unwrap_err();
    assert!(matches!(error, FileError::NotAMask { .. }), "{error:?}");
    assert!(
        error.source().unwrap().to_string().starts_with("grey pixels: 1, the first at x 1, y 0 with value 9")
    );
}

/// Reads must end in a value or an error, and so must what is read.
fn read_all(bytes: &[u8]) -> Result<GrayImage, FileError> {
    let (_folder, path) = folder_with("any.png", bytes);
    let _ = (Mask::load(&path), read_texts(&path));
    read_gray(&path)
}

fn mask_png(texts: &[(&str, String)]) -> Vec<u8> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mask.png");
    write_gray(&path, &some_mask().to_gray(), texts).unwrap();
    fs::read(&path).unwrap()
}

proptest! {
    #[test]
    fn any_mask_survives_its_file(
        (width, height) in (1_u32..40, 1_u32..40),
        masked in prop::collection::vec(any::<bool>(), 40 * 40),
        text in any::<String>(),
    ) {
        let mask = Mask::from_fn(width, height, |x, y| masked[(y * width + x) as usize]);
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("mask.png");
        mask.save(&path, &[("Comment", text.clone())]).unwrap();
        prop_assert_eq!(Mask::load(&path).unwrap(), mask);
        prop_assert_eq!(read_texts(&path).unwrap(), [("Comment".to_owned(), text)]);
    }

    #[test]
    fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(read_all(&bytes).is_err());
        let signed = [b"\x89PNG\r\n\x1a\n".as_slice(), &bytes].concat();
        prop_assert!(read_all(&signed).is_err());
    }

    #[test]
    fn a_truncated_image_is_refused(cut in any::<prop::sample::Index>()) {
        // The pixels end before the closing IEND chunk of 12 bytes.
        let bytes = mask_png(&[]);
        prop_assert!(read_all(&bytes[..cut.index(bytes.len() - 12)]).is_err());
    }

    #[test]
    fn flipped_bits_never_change_a_mask_silently(flips in prop::collection::vec(any::<prop::sample::Index>(), 1..4)) {
        let mut bytes = mask_png(&[("Author", "Žižka".to_owned()), ("Software", "uvcam".to_owned())]);
        for flip in flips {
            let bit = flip.index(bytes.len() * 8);
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        if let Ok(gray) = read_all(&bytes) {
            prop_assert_eq!(gray, some_mask().to_gray());
        }
    }
}
