//! Files that nobody means well with, or that are no files: an error at once, never a panic, never much memory.
#![allow(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

mod raw_png;

use std::error::Error as _;
use std::fs::{self, File};
use std::os::unix::net::UnixListener;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use raw_png::{COLOURS, RawPng, exif};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use tempfile::TempDir;
use uvcam_masker::check::{Problem, check};
use uvcam_masker::file::{
    FileError, MAX_BYTES, PngError, mask_image, read_bytes, read_frame, read_gray, read_texts,
};
use uvcam_masker::mask::{MAX_RUNS, MaskError};
use uvcam_masker::{GrayImage, Mask};

/// Mutated files that are read.
const MUTATIONS: u64 = 40_000;

fn mask() -> RawPng {
    RawPng::new((2, 1), 0, 8, &[0, 255])
}

fn colours() -> RawPng {
    RawPng::new((2, 1), 3, 8, &[0, 1])
}

fn fault(bytes: &[u8]) -> String {
    match mask_image(Path::new("mask.png"), bytes, None).unwrap_err() {
        error @ FileError::Decode { .. } => error.source().unwrap().to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = TempDir::new().unwrap();
    let pipe = folder.path().join("pipe.png");
    mknodat(CWD, &pipe, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
    let socket = folder.path().join("socket.png");
    let _listener = UnixListener::bind(&socket).unwrap();
    for (path, what) in [
        (pipe.as_path(), "it is a named pipe, not a file"),
        (folder.path(), "it is a folder, not a file"),
        (Path::new("/dev/zero"), "it is a device, not a file"),
        (&socket, ""),
    ] {
        let error = Mask::load(path).unwrap_err();
        assert!(matches!(error, FileError::Read { .. }), "{error:?}");
        assert!(error.source().unwrap().to_string().contains(what), "{error:?}");
    }
}

#[test]
fn a_long_file_is_refused_before_it_is_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("long.png");
    File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
    let error = read_bytes(&path).unwrap_err();
    assert!(matches!(error, FileError::TooLong { length, .. } if length == MAX_BYTES + 1), "{error:?}");
    assert!(error.to_string().contains("has 67108865 bytes, more than 67108864"), "{error}");
}

#[test]
fn a_palette_that_is_cut_off_is_named() {
    let bytes = colours().with(b"PLTE", &[255; 7]).bytes();
    assert_eq!(fault(&bytes), "chunk PLTE has a length that is no multiple of 3");
}

#[test]
fn every_fault_of_a_chunk_is_named() {
    let palette = || colours().with(b"PLTE", &[0, 0, 0, 255, 255, 255]);
    let mut headless = mask();
    headless.0.remove(0);
    let mut short = mask();
    short.0[0].1.pop();
    let mut endless = mask();
    endless.0.pop();
    for (png, expected) in [
        (headless, "chunk IDAT comes first, where IHDR must be"),
        (short, "chunk IHDR is not 13 bytes long"),
        (endless, "it ends too early"),
        (palette().with(b"PLTE", &[1, 2, 3]), "chunk PLTE is there twice"),
        (colours().with_after(b"PLTE", &[1, 2, 3]), "chunk PLTE comes after the pixels"),
        (palette().with(b"tRNS", &[1]).with(b"tRNS", &[1]), "chunk tRNS is there twice"),
        (palette().with_after(b"tRNS", &[1]), "chunk tRNS comes after the pixels"),
        (palette().with(b"tRNS", &[1, 2, 3]), "chunk tRNS does not fit the colours of the image"),
        (palette().with(b"tRNS", &[]), "chunk tRNS does not fit the colours of the image"),
        (
            colours().with(b"tRNS", &[1]).with(b"PLTE", &[0; 6]),
            "chunk tRNS does not fit the colours of the image",
        ),
        (mask().with(b"tRNS", &[0]), "chunk tRNS does not fit the colours of the image"),
        (mask().with(b"tRNS", &[0, 1, 2]), "chunk tRNS does not fit the colours of the image"),
        (
            RawPng::new((1, 1), 4, 8, &[0, 255]).with(b"tRNS", &[0, 0]),
            "chunk tRNS does not fit the colours of the image",
        ),
        (mask().with(b"CgBI", &[0; 4]), "chunk CgBI is not known"),
    ] {
        assert_eq!(fault(&png.bytes()), expected);
    }
    assert_eq!(fault(b"GIF89a"), "it does not begin as a PNG file does");
    let mut damaged = mask().with(b"tEXt", b"Author\0me").bytes();
    let place = damaged.windows(2).position(|two| two == b"me").unwrap();
    damaged[place] = b'h';
    assert_eq!(fault(&damaged), "chunk tEXt does not have the check sum that it names");
    let mut cut = mask().bytes();
    cut.truncate(cut.len() - 20);
    assert_eq!(fault(&cut), "it ends too early");
}

#[test]
fn pixels_that_cannot_be_decoded_are_refused() {
    let mut png = mask();
    png.0[1].1 = vec![1, 2, 3];
    let error = mask_image(Path::new("mask.png"), &png.bytes(), None).unwrap_err();
    assert!(matches!(error, FileError::Decode { source: PngError::Decoder(_), .. }), "{error:?}");
}

#[test]
fn a_large_picture_in_a_small_file_is_refused_by_its_header() {
    let mut png = RawPng::new((8, 1), 0, 1, &[0xaa]);
    png.0[0].1[..8].copy_from_slice(&[0, 0, 0x20, 0, 0, 0, 0x20, 0]);
    let error = mask_image(Path::new("mask.png"), &png.bytes(), None).unwrap_err();
    assert!(matches!(error, FileError::TooLarge { width: 8192, height: 8192, .. }), "{error:?}");
}

#[test]
fn texts_that_swell_together_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("image.png");
    let texts = |count: usize| {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
        for _ in 0..count {
            encoder.add_ztxt_chunk("Comment".to_owned(), "a".repeat(400_000)).unwrap();
        }
        encoder.write_header().unwrap().write_image_data(&[0]).unwrap();
        fs::write(&path, bytes).unwrap();
        read_texts(&path)
    };
    assert_eq!(texts(2).unwrap().len(), 2);
    assert!(matches!(texts(3), Err(FileError::Decode { .. })));
    fs::write(&path, mask().with(b"tEXt", &[b"Comment\0".as_slice(), &[b'a'; 1 << 20]].concat()).bytes())
        .unwrap();
    let error = read_texts(&path).unwrap_err();
    assert_eq!(error.source().unwrap().to_string(), "its texts are longer than 1048576 bytes");
    // A mask flies whatever its texts.
    assert!(Mask::load(&path).is_ok());
}

#[test]
fn a_ragged_mask_is_refused_before_it_is_taken_apart() {
    let ragged = GrayImage::from_fn(2048, 1100, |x, _| [u8::from(x % 2 == 0) * 255].into());
    let runs = 1024 * 1100;
    assert!(runs > MAX_RUNS);
    let refusal = Mask::from_gray(&ragged).unwrap_err();
    assert_eq!(refusal, MaskError::TooManyRuns { runs });
    let message =
        "1126400 runs of masked pixels, more than 1048576; no airframe is so ragged: draw it in plain shapes";
    assert_eq!(refusal.to_string(), message);
    assert_eq!(Mask::try_binarised(&ragged, 128), Err(refusal));
    let report = check(&ragged, None);
    assert_eq!(report.problems, [Problem::TooManyRuns { runs }]);
    assert_eq!((report.problems[0].to_string().as_str(), report.can_fly()), (message, false));
    assert_eq!((report.runs, report.masked_px), (runs, runs as u64));
}

/// Numbers that look random and are the same in every run (xorshift64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % end.max(1)
    }

    fn byte(&mut self) -> u8 {
        [0, 1, 2, 3, 4, 6, 8, 16, 127, 128, 255, self.below(256) as u8][self.below(12)]
    }
}

/// One sound file of each colour type and depth, plain and interlaced, with everything that a decoder looks at.
fn seeds() -> Vec<RawPng> {
    let depths = |colour| match colour {
        0 => &[1, 2, 4, 8, 16][..],
        3 => &[1, 2, 4, 8],
        _ => &[8, 16],
    };
    let mut seeds = Vec::new();
    for (colour, samples) in COLOURS {
        for depth in depths(colour) {
            let row_bytes = (9 * samples * usize::from(*depth)).div_ceil(8);
            let pixels: Vec<u8> = (0..row_bytes * 7).map(|n| (n * 89) as u8).collect();
            let mut files = vec![RawPng::new((9, 7), colour, *depth, &pixels)];
            if *depth >= 8 {
                files.push(RawPng::interlaced((9, 7), colour, *depth, &pixels));
            }
            for file in files {
                let file = match colour {
                    0 => file.with(b"tRNS", &[0, 7]),
                    2 => file.with(b"tRNS", &[0, 7, 0, 7, 0, 7]),
                    3 => file.with(b"PLTE", &[99; 6]).with(b"tRNS", &[255, 1]),
                    _ => file,
                };
                let text =
                    file.with(b"tEXt", b"Author\0me").with(b"zTXt", b"Comment\0\0\x78\x01\x03\0\0\0\0\x01");
                seeds.push(
                    text.with(b"iTXt", b"Comment\0\0\0\0\0text")
                        .with(b"eXIf", &exif(1))
                        .with(b"gAMA", &[0, 1, 0, 0])
                        .with(b"acTL", &[0, 0, 0, 1, 0, 0, 0, 0]),
                );
            }
        }
    }
    seeds
}

fn mutated(seed: &RawPng, dice: &mut Dice) -> Vec<u8> {
    let mut png = seed.clone();
    for _ in 0..=dice.below(3) {
        let chunks = png.0.len();
        let place = dice.below(chunks);
        match dice.below(10) {
            0..=3 => {
                let data = &mut png.0[place].1;
                let byte = dice.below(data.len());
                if let Some(byte) = data.get_mut(byte) {
                    *byte = dice.byte();
                }
            }
            4 => {
                let length = dice.below(png.0[place].1.len());
                png.0[place].1.truncate(length);
            }
            5 => {
                let more = dice.below(300);
                let byte = dice.byte();
                let longer = png.0[place].1.len() + more;
                png.0[place].1.resize(longer, byte);
            }
            6 => {
                let chunk = png.0[place].clone();
                png.0.insert(dice.below(chunks), chunk);
            }
            7 => drop(png.0.remove(place).0),
            8 => png.0.swap(place, dice.below(chunks)),
            _ => png.0[place].0 = png.0[dice.below(chunks)].0,
        }
        if png.0.is_empty() {
            break;
        }
    }
    let mut bytes = png.bytes();
    if dice.below(8) == 0 {
        let place = dice.below(bytes.len());
        bytes[place] ^= 1 << dice.below(8);
    }
    bytes
}

#[test]
fn no_mutated_file_makes_a_reader_panic() {
    // In memory: a disk that each file reached would be all that this measures.
    let folder = TempDir::new_in("/dev/shm").unwrap();
    let path = folder.path().join("mutated.png");
    let (seeds, mut dice, mut sound) = (seeds(), Dice(0x5eed), 0);
    for seed in &seeds {
        fs::write(&path, seed.bytes()).unwrap();
        assert!(read_gray(&path).is_ok(), "{:?}", read_gray(&path));
    }
    for number in 0..MUTATIONS {
        let bytes = mutated(&seeds[dice.below(seeds.len())], &mut dice);
        fs::write(&path, &bytes).unwrap();
        let read = || {
            let _ =
                (Mask::load(&path), read_texts(&path), read_frame(&path).map(|frame| frame.unscaled_bits()));
            read_gray(&path).is_ok()
        };
        match catch_unwind(AssertUnwindSafe(read)) {
            Ok(is_sound) => sound += u64::from(is_sound),
            Err(_) => panic!("mutation {number} makes a reader panic: {}", bytes.escape_ascii()),
        }
    }
    println!("{MUTATIONS} mutated files, {sound} of them still sound");
    // Mutations that never get past the first check would show nothing.
    assert!(sound > MUTATIONS / 20 && sound < MUTATIONS, "{sound}");
}
