//! PNG files put together chunk by chunk, sound and unsound.
#![allow(dead_code, reason = "each test program uses a part of it")]

/// A file as its chunks: type and data.
#[derive(Clone)]
pub struct RawPng(pub Vec<([u8; 4], Vec<u8>)>);

/// Samples of a pixel, by colour type.
pub const COLOURS: [(u8, usize); 5] = [(0, 1), (2, 3), (3, 1), (4, 2), (6, 4)];

impl RawPng {
    /// An image of raw rows without filter, `pixels` being one row after the other in packed samples, the upper byte first.
    pub fn new((width, height): (u32, u32), colour: u8, depth: u8, pixels: &[u8]) -> Self {
        let rows = pixels.chunks(pixels.len() / height as usize);
        let scanlines = rows.flat_map(|row| [&[0], row].concat()).collect::<Vec<u8>>();
        Self::with_scanlines((width, height), colour, depth, 0, &scanlines)
    }

    /// An image of the seven passes of Adam7; `pixels` as above, in whole bytes.
    pub fn interlaced((width, height): (u32, u32), colour: u8, depth: u8, pixels: &[u8]) -> Self {
        let bytes = pixels.len() / (width * height) as usize;
        let passes = [
            (0, 0, 8, 8),
            (4, 0, 8, 8),
            (0, 4, 4, 8),
            (2, 0, 4, 4),
            (0, 2, 2, 4),
            (1, 0, 2, 2),
            (0, 1, 1, 2),
        ];
        let mut scanlines = Vec::new();
        for (x0, y0, dx, dy) in passes {
            for y in (y0..height as usize).step_by(dy).filter(|_| x0 < width as usize) {
                scanlines.push(0);
                for x in (x0..width as usize).step_by(dx) {
                    scanlines.extend(&pixels[(y * width as usize + x) * bytes..][..bytes]);
                }
            }
        }
        Self::with_scanlines((width, height), colour, depth, 1, &scanlines)
    }

    fn with_scanlines(
        (width, height): (u32, u32),
        colour: u8,
        depth: u8,
        interlace: u8,
        scanlines: &[u8],
    ) -> Self {
        let header =
            [&width.to_be_bytes()[..], &height.to_be_bytes(), &[depth, colour, 0, 0, interlace]].concat();
        RawPng(vec![(*b"IHDR", header), (*b"IDAT", zlib(scanlines)), (*b"IEND", Vec::new())])
    }

    /// With a chunk before the pixels.
    pub fn with(mut self, kind: &[u8; 4], data: &[u8]) -> Self {
        let place = self.0.len() - 2;
        self.0.insert(place, (*kind, data.to_vec()));
        self
    }

    /// With a chunk behind the pixels.
    pub fn with_after(mut self, kind: &[u8; 4], data: &[u8]) -> Self {
        let place = self.0.len() - 1;
        self.0.insert(place, (*kind, data.to_vec()));
        self
    }

    /// The file, with right check sums.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        for (kind, data) in &self.0 {
            bytes.extend((data.len() as u32).to_be_bytes());
            let start = bytes.len();
            bytes.extend(kind);
            bytes.extend(data);
            let sum = crc32fast::hash(&bytes[start..]);
            bytes.extend(sum.to_be_bytes());
        }
        bytes
    }
}

/// EXIF data with an orientation, as chunk eXIf holds it.
pub fn exif(orientation: u16) -> Vec<u8> {
    let [high, low] = orientation.to_be_bytes();
    [b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01", &[high, low][..], &[0; 6]].concat()
}

/// A zlib stream of stored blocks.
fn zlib(data: &[u8]) -> Vec<u8> {
    let mut stream = vec![0x78, 1];
    let mut blocks = data.chunks(0xffff).peekable();
    while let Some(block) = blocks.next() {
        let length = block.len() as u16;
        stream.push(u8::from(blocks.peek().is_none()));
        stream.extend(length.to_le_bytes());
        stream.extend((!length).to_le_bytes());
        stream.extend(block);
    }
    let (a, b) = data.iter().fold((1_u32, 0_u32), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65521;
        (a, (b + a) % 65521)
    });
    stream.extend((b << 16 | a).to_be_bytes());
    stream
}
