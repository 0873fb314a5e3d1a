//! Masks and greyscale images as PNG files.
//!
//! Any PNG image can be read; what is written is always 8-bit grey. A file is replaced as a whole or not at
//! all: a temporary file in the same folder is written, synced and renamed over the old one.

use std::fs::{File, Permissions};
use std::io::{self, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Decoder, DecodingError, EncodingError, Transformations};
use thiserror::Error;

use crate::image::{GrayImage, RgbImage};
use crate::mask::{Mask, MaskError};

/// Largest image that is read, in pixels; keeps a damaged header from exhausting the memory.
pub const MAX_PIXELS: u64 = 64 << 20;

/// Longest compressed text that is read, in bytes once decompressed.
const MAX_TEXT: usize = 1 << 20;

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
        /// What the decoder found.
        source: DecodingError,
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

impl Mask {
    /// Reads a mask: any PNG image that [`read_gray`] turns into 0 (discard) and 255 (keep) only.
    ///
    /// # Errors
    /// Those of [`read_gray`], and [`FileError::NotAMask`] where the image is not binary.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let gray = read_gray(path)?;
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
/// differ from OpenCV, by one.
///
/// # Errors
/// [`FileError::Read`], [`FileError::Decode`] or [`FileError::TooLarge`].
pub fn read_gray(path: &Path) -> Result<GrayImage, FileError> {
    let mut decoder = open(path)?;
    let decoded = |source| not_decoded(path, source);
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(decoded)?;
    let (width, height) = (reader.info().width, reader.info().height);
    let too_large = || FileError::TooLarge { path: path.to_owned(), width, height };

    let mut samples = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    let frame = reader.next_frame(&mut samples).map_err(decoded)?;
    samples.truncate(frame.buffer_size());
    let pixels = match frame.color_type {
        ColorType::Grayscale | ColorType::Indexed => samples,
        ColorType::GrayscaleAlpha => samples.chunks_exact(2).map(|pixel| pixel[0]).collect(),
        colour @ (ColorType::Rgb | ColorType::Rgba) => {
            samples.chunks_exact(colour.samples()).map(|pixel| luma([pixel[0], pixel[1], pixel[2]])).collect()
        }
    };
    GrayImage::from_raw(width, height, pixels).ok_or_else(too_large)
}

/// Reads the texts of a PNG file (tEXt, zTXt and iTXt chunks, in this order) as pairs of keyword and text.
///
/// # Errors
/// [`FileError::Read`], [`FileError::Decode`] or [`FileError::TooLarge`].
pub fn read_texts(path: &Path) -> Result<Vec<(String, String)>, FileError> {
    let decoded = |source| not_decoded(path, source);
    let mut reader = open(path)?.read_info().map_err(decoded)?;
    // Texts may also follow the pixels.
    reader.finish().map_err(decoded)?;
    let info = reader.info();
    let mut texts = Vec::new();
    for chunk in &info.uncompressed_latin1_text {
        texts.push((chunk.keyword.clone(), chunk.text.clone()));
    }
    for mut chunk in info.compressed_latin1_text.iter().cloned() {
        chunk.decompress_text_with_limit(MAX_TEXT).map_err(decoded)?;
        texts.push((chunk.keyword.clone(), chunk.get_text().map_err(decoded)?));
    }
    for mut chunk in info.utf8_text.iter().cloned() {
        chunk.decompress_text_with_limit(MAX_TEXT).map_err(decoded)?;
        texts.push((chunk.keyword.clone(), chunk.get_text().map_err(decoded)?));
    }
    Ok(texts)
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

fn open(path: &Path) -> Result<Decoder<BufReader<File>>, FileError> {
    let file = File::open(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
    let mut decoder = Decoder::new(BufReader::new(file));
    let info = decoder.read_header_info().map_err(|source| not_decoded(path, source))?;
    let (width, height) = (info.width, info.height);
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(FileError::TooLarge { path: path.to_owned(), width, height });
    }
    Ok(decoder)
}

fn not_decoded(path: &Path, source: DecodingError) -> FileError {
    let path = path.to_owned();
    match source {
        // A file that ends early is a damaged image, not a failing disk.
        DecodingError::IoError(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
            FileError::Read { path, source }
        }
        source => FileError::Decode { path, source },
    }
}

/// BT.601 luma with weights in units of 2^-15; they add up to 1, so greys keep their value.
fn luma(rgb: [u8; 3]) -> u8 {
    let [red, green, blue] = rgb.map(u32::from);
    ((9797 * red + 19234 * green + 3737 * blue) >> 15) as u8
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

fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    // Opened first, so that a folder that cannot be synced is refused before anything changes.
    let directory = File::open(folder)?;
    // Consumers may run under another user; the umask has the last word.
    let mut temporary = tempfile::Builder::new()
        .prefix(".mask-")
        .suffix(".tmp")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    temporary.write_all(content)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|error| error.error)?;
    directory.sync_all()
}
