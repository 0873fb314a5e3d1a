//! Masks in real use, where the reference data lies beside the repository or in `$UVCAM_SHARED`.

use std::path::{Path, PathBuf};

use uvcam_masker::check::{Problem, check};
use uvcam_masker::file::{FileError, read_gray};
use uvcam_masker::mask::MaskError;
use uvcam_masker::{GrayImage, Mask};

/// In the data, but not binary.
const REFUSED: [&str; 2] = ["default_back.png", "X18_25003578.png"];

fn folder() -> Option<PathBuf> {
    let shared = std::env::var_os("UVCAM_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let folder = shared.join("data/masks");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("reference masks not present: {}", folder.display());
    None
}

/// Masked runs and pixels, counted pixel by pixel.
fn counted(gray: &GrayImage) -> (usize, u64) {
    let mut found = (0, 0);
    for row in gray.rows() {
        let mut before = 255;
        for pixel in row {
            found.1 += u64::from(pixel.0[0] == 0);
            found.0 += usize::from(pixel.0[0] == 0 && before != 0);
            before = pixel.0[0];
        }
    }
    found
}

#[test]
fn binary_masks_load_with_their_runs_and_areas() {
    let Some(folder) = folder() else { return };
    let mut loaded = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.extension().is_none_or(|extension| extension != "png") || REFUSED.contains(&name) {
            continue;
        }
        let mask = Mask::load(&path).unwrap();
        let gray = read_gray(&path).unwrap();
        assert_eq!((mask.runs().len(), mask.masked_px()), counted(&gray), "{name}");
        assert_eq!(mask.to_gray(), gray, "{name}");
        println!("{name}: {} runs, {} px, {}", mask.runs().len(), mask.masked_px(), mask.id());
        loaded += 1;
    }
    assert!(loaded > 0, "no mask was read");
}

#[test]
fn images_with_grey_pixels_are_refused() {
    let Some(folder) = folder() else { return };
    for name in REFUSED {
        let path = folder.join(name);
        let error = Mask::load(&path).unwrap_err();
        let FileError::NotAMask { source: MaskError::NotBinary { grey_px, .. }, .. } = error else {
            panic!("{name}: {error}");
        };
        let report = check(&read_gray(&path).unwrap(), None);
        assert_eq!(report.problems, [Problem::NotBinary { grey_px }], "{name}");
        assert!(!report.can_fly(), "{name}");
        println!("{name}: {grey_px} grey pixels");
    }
}

#[test]
fn the_blank_mask_flies_with_a_warning() {
    let Some(folder) = folder() else { return };
    let report = check(&read_gray(&folder.join("blank_bluefox.png")).unwrap(), Some((752, 480)));
    assert_eq!(report.problems, [Problem::NothingMasked]);
    assert!(report.can_fly());
}
