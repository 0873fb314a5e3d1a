//! The chunks of a PNG file, checked before a decoder sees them.
//!
//! A decoder forgives what looks harmless to it, and a transparent pixel that it forgives flies unmasked; it trusts
//! what it should not, such as a palette's length. So the structure is checked here, check sums included, and the
//! decoder is handed only the chunks that make the pixels. Names and rules are those of the PNG specification
//! (ISO/IEC 15948), sections 5 and 11.

use ::image::metadata::Orientation;
use png::DecodingError;
use thiserror::Error;

/// What a PNG file begins with.
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Longest texts of a file that are read, in bytes, compressed and decompressed.
pub(super) const MAX_TEXT: usize = 1 << 20;

/// Chunks that hold texts.
const TEXTS: [&[u8; 4]; 3] = [b"tEXt", b"zTXt", b"iTXt"];

/// Indexed colour, of the colour types.
const INDEXED: u8 = 3;

/// Why the content of a file is no sound PNG image.
#[derive(Debug, Error)]
pub enum PngError {
    /// The signature is missing.
    #[error("it does not begin as a PNG file does")]
    Signature,
    /// The file ends within a chunk, or without the last one.
    #[error("it ends too early")]
    Truncated,
    /// A chunk was damaged.
    #[error("chunk {kind} does not have the check sum that it names")]
    CheckSum {
        /// Type of the chunk.
        kind: String,
    },
    /// A chunk is not what the specification asks for.
    #[error("chunk {kind} {fault}")]
    Chunk {
        /// Type of the chunk.
        kind: String,
        /// What is wrong with it.
        fault: &'static str,
    },
    /// The texts are longer than anything that is written into a mask.
    #[error("its texts are longer than {MAX_TEXT} bytes")]
    Texts,
    /// The pixels or a text cannot be decoded.
    #[error(transparent)]
    Decoder(#[from] DecodingError),
}

/// The begin of a file: its size in pixels, and how they are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) width: u32,
    pub(super) height: u32,
    depth: u8,
    colour: u8,
}

impl Header {
    /// Reads the header alone.
    pub(super) fn of(file: &[u8]) -> Result<Self, PngError> {
        let rest = file.strip_prefix(SIGNATURE).ok_or(PngError::Signature)?;
        let first = Chunks { rest }.next().ok_or(PngError::Truncated)??;
        let fault = |fault| first.fault(fault);
        match (first.kind, first.data) {
            (b"IHDR", [w0, w1, w2, w3, h0, h1, h2, h3, depth, colour, _, _, _]) => Ok(Self {
                width: u32::from_be_bytes([*w0, *w1, *w2, *w3]),
                height: u32::from_be_bytes([*h0, *h1, *h2, *h3]),
                depth: *depth,
                colour: *colour,
            }),
            (b"IHDR", _) => Err(fault("is not 13 bytes long")),
            _ => Err(fault("comes first, where IHDR must be")),
        }
    }
}

/// What a sound file holds.
#[derive(Debug)]
pub(super) struct Checked {
    /// How the picture is to be turned before it is looked at; [`Orientation::NoTransforms`] where nothing says so.
    pub(super) orientation: Orientation,
    /// A PNG file of the chunks that make the pixels alone.
    pub(super) pixels: Vec<u8>,
}

/// Checks the structure of a file.
pub(super) fn check(file: &[u8]) -> Result<Checked, PngError> {
    let header = Header::of(file)?;
    let mut orientation = Orientation::NoTransforms;
    let mut pixels = Vec::with_capacity(file.len());
    pixels.extend(SIGNATURE);
    let mut palette_entries = None;
    let (mut has_transparency, mut has_pixels) = (false, false);
    for chunk in (Chunks { rest: &file[SIGNATURE.len()..] }) {
        let chunk = chunk?;
        match chunk.kind {
            b"IHDR" => {}
            b"PLTE" if palette_entries.is_some() => return Err(chunk.fault("is there twice")),
            b"PLTE" if has_pixels => return Err(chunk.fault("comes after the pixels")),
            b"PLTE" if chunk.data.len() % 3 != 0 => {
                return Err(chunk.fault("has a length that is no multiple of 3"));
            }
            b"PLTE" => palette_entries = Some(chunk.data.len() / 3),
            b"tRNS" if has_transparency => return Err(chunk.fault("is there twice")),
            b"tRNS" if has_pixels => return Err(chunk.fault("comes after the pixels")),
            b"tRNS" => {
                let entries = palette_entries.unwrap_or(0);
                let is_sound = match header.colour {
                    0 => chunk.data.len() == 2,
                    2 => chunk.data.len() == 6,
                    INDEXED => (1..=entries).contains(&chunk.data.len()),
                    _ => false,
                };
                if !is_sound {
                    return Err(chunk.fault("does not fit the colours of the image"));
                }
                has_transparency = true;
            }
            b"IDAT" => has_pixels = true,
            b"IEND" => {
                pixels.extend(chunk.whole);
                return Ok(Checked { orientation, pixels });
            }
            b"eXIf" => {
                let turned =
                    Orientation::from_exif_chunk(chunk.data).filter(|o| *o != Orientation::NoTransforms);
                orientation = turned.unwrap_or(orientation);
                continue;
            }
            // An upper-case letter: nobody may show the picture without understanding this chunk.
            [b'A'..=b'Z', ..] => return Err(chunk.fault("is not known")),
            _ => continue,
        }
        pixels.extend(chunk.whole);
    }
    Err(PngError::Truncated)
}

/// A PNG file of the texts and the pixels of a file, texts first.
pub(super) fn with_texts(file: &[u8]) -> Result<Vec<u8>, PngError> {
    let Checked { pixels, .. } = check(file)?;
    let mut texts = Vec::new();
    for chunk in (Chunks { rest: &file[SIGNATURE.len()..] }) {
        let chunk = chunk?;
        if TEXTS.contains(&chunk.kind) {
            texts.extend(chunk.whole);
        }
        if chunk.kind == b"IEND" {
            break;
        }
    }
    if texts.len() > MAX_TEXT {
        return Err(PngError::Texts);
    }
    // Behind signature and header, which is the first chunk.
    let header = SIGNATURE.len() + Chunk::AROUND + 13;
    let (header, rest) = pixels.split_at_checked(header).ok_or(PngError::Truncated)?;
    Ok([header, &texts, rest].concat())
}

/// One chunk of a file.
#[derive(Debug, Clone, Copy)]
struct Chunk<'a> {
    kind: &'a [u8; 4],
    data: &'a [u8],
    /// With its length before, and its check sum behind.
    whole: &'a [u8],
}

impl Chunk<'_> {
    /// Bytes of length, type and check sum.
    const AROUND: usize = 12;

    fn fault(&self, fault: &'static str) -> PngError {
        PngError::Chunk { kind: self.name(), fault }
    }

    fn name(&self) -> String {
        self.kind.escape_ascii().to_string()
    }
}

/// The chunks of a file, one after the other, their check sums checked.
struct Chunks<'a> {
    rest: &'a [u8],
}

impl<'a> Chunks<'a> {
    fn cut(&mut self) -> Result<Chunk<'a>, PngError> {
        let (length, after) = self.rest.split_first_chunk().ok_or(PngError::Truncated)?;
        let length = u32::from_be_bytes(*length) as usize;
        let (kind, after) = after.split_first_chunk().ok_or(PngError::Truncated)?;
        let (data, after) = after.split_at_checked(length).ok_or(PngError::Truncated)?;
        let (sum, after) = after.split_first_chunk().ok_or(PngError::Truncated)?;
        let whole = &self.rest[..Chunk::AROUND + length];
        self.rest = after;
        let chunk = Chunk { kind, data, whole };
        let found = crc32fast::hash(&whole[4..8 + length]);
        if found == u32::from_be_bytes(*sum) {
            Ok(chunk)
        } else {
            Err(PngError::CheckSum { kind: chunk.name() })
        }
    }
}

impl<'a> Iterator for Chunks<'a> {
    type Item = Result<Chunk<'a>, PngError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let cut = self.cut();
        if cut.is_err() {
            self.rest = &[];
        }
        Some(cut)
    }
}
