//! Masks and greyscale images as PNG files.
//!
//! Any PNG image can be read; what is written is always 8-bit grey. A file is read whole and checked before it is decoded, and what
//! it may cost is bounded: [`MAX_BYTES`], [`MAX_PIXELS`]. A file is replaced as a whole or not at all: a temporary file in the
//! same folder is written, synced and renamed over the old one.

mod chunks;
mod picture;
mod whole;

use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
use std::path::{Path, PathBuf};

use ::image::metadata::Orientation;
use png::{BitDepth, ColorType, Decoder, EncodingError};
use thiserror::Error;

use self::chunks::{Header, MAX_TEXT};
use self::picture::Picture;
use crate::image::{GrayImage, RgbImage};
use crate::mask::{Mask, MaskError};

pub use self::chunks::PngError;
pub use self::whole::read_bytes;

/// Largest image that is read, in pixels: 8192 x 4096, more than the frames of any camera that a UAV carries for this.
pub const MAX_PIXELS: u64 = 32 << 20;

/// Longest file that is read, in bytes: room for such an image without compression.
pub const MAX_BYTES: u64 = 64 << 20;

/// 16-bit samples that are all below this are 12-bit samples that were not scaled.
const SCALED: u16 = 1 << 12;

/// Why a file cannot be read or written.
#[derive(Debug, Error)]
pub enum FileError {
    /// The file cannot be opened or read.
    #[error("cannot read `{path}`; name a PNG file that exists and that this user may read")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The content is damaged or not PNG.
    #[error("`{path}` is not a sound PNG image; export or generate it again")]
    Decode {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PngError,
    },
    /// The file has more than [`MAX_BYTES`] bytes.
    #[error(
        "`{path}` has {length} bytes, more than {MAX_BYTES}; name a PNG image of the size of the camera's frames"
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
    },
    /// The image has more than [`MAX_PIXELS`] pixels.
    #[error(
        "`{path}` is {width}x{height}, more than {MAX_PIXELS} pixels; scale it to the size of the camera's frames"
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// The image is no mask.
    #[error("`{path}` cannot be used as a mask")]
    NotAMask {
        /// The file.
        path: PathBuf,
        /// What is wrong with the image, and the remedy.
        source: MaskError,
    },
    /// The image is no frame of a camera.
    #[error("`{path}` cannot be used as a frame")]
    NotAFrame {
        /// The file.
        path: PathBuf,
        /// What is wrong with the image, and the remedy.
        source: FrameError,
    },
    /// The image or a text cannot be expressed in PNG.
    #[error(
        "cannot encode `{path}` as PNG; an image has at least one pixel, \
         the keyword of a text 1 to 79 Latin-1 characters"
    )]
    Encode {
        /// The file.
        path: PathBuf,
        /// What the encoder refused.
        source: EncodingError,
    },
    /// The file cannot be written.
    #[error("cannot write `{path}`; its folder must exist, be readable and writable, and have free space")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Why an image is no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FrameError {
    /// What is below is not known: editors keep the colour, or make it black or white.
    #[error("{transparent_px} transparent pixels; use the frame as the camera gave it, without transparency")]
    Transparent {
        /// Number of pixels that are not opaque.
        transparent_px: u64,
    },
    /// The camera's rows are not the rows that a person sees.
    #[error(
        "EXIF orientation {orientation}; use the frame as the camera gave it, or save it upright (orientation 1)"
    )]
    Turned {
        /// The orientation, 2 to 8.
        orientation: u8,
    },
    /// Samples of fewer bits were stored in 16 as they were, which is almost black.
    #[error("these pictures use {used_bits} of 16 bits; scale them to all 16, or save them with 8")]
    Unscaled {
        /// Bits that the largest sample needs.
        used_bits: u32,
    },
}

/// A frame from a file.
#[derive(Debug)]
pub struct Frame {
    /// Its grey values, those of [`read_gray`].
    pub gray: GrayImage,
    largest_of_16_bits: Option<u16>,
}

impl Frame {
    /// Bits that the samples use where they have 16 and 12 suffice, as recorders write frames of 12 bits; 0 for a black frame. `None`
    /// where the frame has 8 bits, or uses more. One frame may be that dark; where all of a set are, and not all black, they were not
    /// scaled: [`FrameError::Unscaled`].
    #[must_use]
    pub fn unscaled_bits(&self) -> Option<u32> {
        let largest = self.largest_of_16_bits.filter(|largest| *largest < SCALED)?;
        Some(u16::BITS - largest.leading_zeros())
    }
}

impl Mask {
    /// Reads a mask: any PNG image that [`read_mask`] takes, with 0 (discard) and 255 (keep) only.
    ///
    /// # Errors
    /// Those of [`read_mask`], and [`FileError::NotAMask`] where the image is not binary.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let gray = read_mask(path, None)?;
        Self::from_gray(&gray).map_err(|source| FileError::NotAMask { path: path.to_owned(), source })
    }

    /// Writes the mask as [`write_gray`] does: 8-bit grey, 0 discard, 255 keep.
    ///
    /// # Errors
    /// Those of [`write_gray`].
    pub fn save(&self, path: &Path, texts: &[(&str, String)]) -> Result<(), FileError> {
        write_gray(path, &self.to_gray(), texts)
    }
}

/// Reads a PNG image of any colour type and bit depth as 8-bit grey.
///
/// Gives the values that OpenCV's `imread` gives in greyscale, which is how UVDAR reads a mask: colours
/// become luma, Y = 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601), rounded down; of 16-bit samples the upper
/// byte counts; 1-, 2- and 4-bit samples are scaled up to 0 to 255; alpha is ignored. Only 16-bit colour may
/// differ from OpenCV, by one. Where a wrong value would fly, [`read_mask`] and [`read_frame`] say more.
///
/// # Errors
/// Those of [`read_bytes`]; [`FileError::Decode`] or [`FileError::TooLarge`].
pub fn read_gray(path: &Path) -> Result<GrayImage, FileError> {
    Ok(decode(path, &read_bytes(path)?)?.gray)
}

/// Reads the image of a mask, for frames of `expected` width and height where these are known.
///
/// # Errors
/// Those of [`read_bytes`] and [`mask_image`].
pub fn read_mask(path: &Path, expected: Option<(u32, u32)>) -> Result<GrayImage, FileError> {
    mask_image(path, &read_bytes(path)?, expected)
}

/// Decodes the image of a mask from the bytes of a file; `path` names it in messages. The size is compared with the `expected` one
/// before anything is decoded.
///
/// # Errors
/// [`FileError::Decode`] or [`FileError::TooLarge`]; [`FileError::NotAMask`] where the size is another one, a pixel is not opaque,
/// or the image is to be turned before it is looked at.
pub fn mask_image(path: &Path, bytes: &[u8], expected: Option<(u32, u32)>) -> Result<GrayImage, FileError> {
    let refused = |source| FileError::NotAMask { path: path.to_owned(), source };
    let found = size(path, bytes)?;
    if let Some(expected) = expected.filter(|expected| *expected != found) {
        return Err(refused(MaskError::WrongSize { found, expected }));
    }
    let picture = decode(path, bytes)?;
    if picture.transparent_px > 0 {
        return Err(refused(MaskError::Transparent { transparent_px: picture.transparent_px }));
    }
    if picture.orientation != Orientation::NoTransforms {
        return Err(refused(MaskError::Turned { orientation: picture.orientation.to_exif() }));
    }
    Ok(picture.gray)
}

/// Reads a frame that is taken for a camera's.
///
/// # Errors
/// Those of [`read_gray`]; [`FileError::NotAFrame`] where a pixel is not opaque, or the image is to be turned before it is looked
/// at.
pub fn read_frame(path: &Path) -> Result<Frame, FileError> {
    let refused = |source| FileError::NotAFrame { path: path.to_owned(), source };
    let picture = decode(path, &read_bytes(path)?)?;
    if picture.transparent_px > 0 {
        return Err(refused(FrameError::Transparent { transparent_px: picture.transparent_px }));
    }
    if picture.orientation != Orientation::NoTransforms {
        return Err(refused(FrameError::Turned { orientation: picture.orientation.to_exif() }));
    }
    Ok(Frame { gray: picture.gray, largest_of_16_bits: picture.largest_of_16_bits })
}

/// Reads the texts of a PNG file (tEXt, zTXt and iTXt chunks, in this order) as pairs of keyword and text; 1 MiB of them at most.
///
/// # Errors
/// Those of [`read_bytes`]; [`FileError::Decode`] or [`FileError::TooLarge`].
pub fn read_texts(path: &Path) -> Result<Vec<(String, String)>, FileError> {
    let bytes = read_bytes(path)?;
    size(path, &bytes)?;
    texts(&bytes).map_err(|source| FileError::Decode { path: path.to_owned(), source })
}

/// The texts of the bytes of a PNG file, as [`read_texts`] gives them.
///
/// # Errors
/// [`PngError`].
pub fn texts(file: &[u8]) -> Result<Vec<(String, String)>, PngError> {
    let reader = Decoder::new(io::Cursor::new(chunks::with_texts(file)?)).read_info()?;
    let info = reader.info();
    let mut texts = Vec::new();
    // For all of them together: a kilobyte swells to a megabyte, and a file has room for many.
    let mut room = MAX_TEXT;
    let mut keep = |keyword: &str, text: String, room: usize| {
        let left = room.checked_sub(text.len()).ok_or(PngError::Texts)?;
        texts.push((keyword.to_owned(), text));
        Ok::<usize, PngError>(left)
    };
    for chunk in &info.uncompressed_latin1_text {
        room = keep(&chunk.keyword, chunk.text.clone(), room)?;
    }
    for mut chunk in info.compressed_latin1_text.iter().cloned() {
        chunk.decompress_text_with_limit(room)?;
        room = keep(&chunk.keyword, chunk.get_text()?, room)?;
    }
    for mut chunk in info.utf8_text.iter().cloned() {
        chunk.decompress_text_with_limit(room)?;
        room = keep(&chunk.keyword, chunk.get_text()?, room)?;
    }
    Ok(texts)
}

/// The size of the image in pixels, from the head of its file.
fn size(path: &Path, bytes: &[u8]) -> Result<(u32, u32), FileError> {
    let header = Header::of(bytes).map_err(|source| FileError::Decode { path: path.to_owned(), source })?;
    let Header { width, height, .. } = header;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(FileError::TooLarge { path: path.to_owned(), width, height });
    }
    Ok((width, height))
}

fn decode(path: &Path, bytes: &[u8]) -> Result<Picture, FileError> {
    let (width, height) = size(path, bytes)?;
    picture::decode(bytes, width, height)
        .map_err(|source| FileError::Decode { path: path.to_owned(), source })
}

/// Writes an 8-bit grey PNG file with `texts`, pairs of keyword and text, each as tEXt chunk where it is
/// Latin-1 and as iTXt chunk (UTF-8) where not.
///
/// On success the file has reached the disk. On failure no temporary file stays behind and an older file of
/// this name is untouched, unless only the last step failed, syncing the folder.
///
/// # Errors
/// [`FileError::Encode`] or [`FileError::Write`].
pub fn write_gray(path: &Path, image: &GrayImage, texts: &[(&str, String)]) -> Result<(), FileError> {
    write(path, image.dimensions(), ColorType::Grayscale, image, texts)
}

/// Writes an 8-bit RGB PNG file, as [`write_gray`] does.
///
/// # Errors
/// [`FileError::Encode`] or [`FileError::Write`].
pub fn write_rgb(path: &Path, image: &RgbImage) -> Result<(), FileError> {
    write(path, image.dimensions(), ColorType::Rgb, image, &[])
}

fn write(
    path: &Path,
    size: (u32, u32),
    color: ColorType,
    samples: &[u8],
    texts: &[(&str, String)],
) -> Result<(), FileError> {
    let png = encode(size, color, samples, texts)
        .map_err(|source| FileError::Encode { path: path.to_owned(), source })?;
    replace(path, &png).map_err(|source| FileError::Write { path: path.to_owned(), source })
}

fn encode(
    (width, height): (u32, u32),
    color: ColorType,
    samples: &[u8],
    texts: &[(&str, String)],
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(BitDepth::Eight);
    for (keyword, text) in texts {
        let (keyword, is_latin_1) = ((*keyword).to_owned(), text.chars().all(|c| u32::from(c) < 256));
        match is_latin_1 {
            true => encoder.add_text_chunk(keyword, text.clone())?,
            false => encoder.add_itxt_chunk(keyword, text.clone())?,
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(bytes)
}

/// Writes a file whole or not at all, as [`write_gray`] does.
///
/// # Errors
/// [`FileError::Write`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    replace(path, bytes).map_err(|source| FileError::Write { path: path.to_owned(), source })
}

fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    // Opened first, so that a folder that cannot be synced is refused before anything changes.
    let directory = File::open(folder)?;
    // Consumers may run under another user; the umask has the last word, but for a file that has its mode already.
    let mut temporary = tempfile::Builder::new()
        .prefix(".mask-")
        .suffix(".tmp")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    let old = fs::metadata(path).ok().filter(fs::Metadata::is_file);
    if let Some(old) = &old {
        temporary.as_file().set_permissions(Permissions::from_mode(old.mode() & 0o777))?;
    }
    give(temporary.as_file(), &old.map_or_else(|| directory.metadata(), Ok)?)?;
    temporary.write_all(content)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|error| error.error)?;
    directory.sync_all()
}

/// Gives what root made to the owner of what it stands for or in, where the system knows that owner and lets root do so: otherwise
/// root's help would lock the owner out.
///
/// # Errors
/// What the system says.
pub fn give(made: &File, to: &fs::Metadata) -> io::Result<()> {
    let made_by = made.metadata()?;
    if made_by.uid() != 0 || (made_by.uid(), made_by.gid()) == (to.uid(), to.gid()) {
        return Ok(());
    }
    match fchown(made, Some(to.uid()), Some(to.gid())) {
        // A namespace without that owner; a root without that capability.
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::PermissionDenied) => Ok(()),
        given => given,
    }
}
