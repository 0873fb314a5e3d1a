//! Saves the newest frame: `save_png FILE [CAMERA [PREFIX ROOT_PATH]]`.

use std::error::Error;
use std::fs::File;
use std::time::Duration;

use uvcam_shm_ipc::{Settings, Subscriber};

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let mut word = |default: &str| words.next().unwrap_or_else(|| default.to_owned());
    let (file, camera) = (word("frame.png"), word("left"));

    let mut subscriber = Subscriber::open(&Settings::new(word("uvcam_"), word("/tmp/uvcam")), &camera)?;
    let frame = loop {
        subscriber.wait(Duration::from_secs(1))?;
        match subscriber.receive_latest()? {
            Some(frame) => break frame,
            None => eprintln!("{camera}: no frame yet"),
        }
    };
    let (header, format) = (frame.header(), frame.header().pixel_format()?);
    let mut encoder = png::Encoder::new(File::create(&file)?, header.width, header.height);
    encoder.set_color(png::ColorType::Grayscale);
    let mut pixels: Vec<u8> = frame.rows().flatten().copied().collect();
    if format.bytes_per_pixel() == 2 {
        // Little-endian with the value in the low bits; PNG has big-endian with all 16 bits in use.
        encoder.set_depth(png::BitDepth::Sixteen);
        for pixel in pixels.chunks_exact_mut(2) {
            let value = u16::from_le_bytes([pixel[0], pixel[1]]) << (16 - format.significant_bits());
            pixel.copy_from_slice(&value.to_be_bytes());
        }
    }
    encoder.write_header()?.write_image_data(&pixels)?;
    println!("{file}: {}x{}, {} lost before", header.width, header.height, frame.lost_before());
    Ok(())
}
