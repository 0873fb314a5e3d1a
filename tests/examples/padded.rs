//! Publishes frames whose rows have padding, which no camera of ours has: `padded PREFIX ROOT_PATH FORMAT STRIDE`, until its standard
//! input ends. For tests of consumers in other languages.

use std::error::Error;
use std::io::Read;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use uvcam_shm_ipc::{FrameHeader, PixelFormat, Publisher, Settings};

const WIDTH: u32 = 30;
const HEIGHT: u32 = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, prefix, root_path, format, stride] = words.as_slice() else {
        return Err("usage: padded PREFIX ROOT_PATH FORMAT STRIDE".into());
    };
    let (format, stride) = (format.parse::<PixelFormat>()?, stride.parse::<u32>()?);
    let bytes_per_pixel = format.bytes_per_pixel();
    let mut publisher =
        Publisher::create(&Settings::new(prefix, root_path), "padded", (stride * HEIGHT) as usize, 2)?;
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        scope.spawn(|| {
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            is_over.store(true, Ordering::Relaxed);
        });
        while !is_over.load(Ordering::Relaxed) {
            let mut slot = publisher.loan()?;
            slot.pixels_mut().fill(255);
            for (row, bytes) in slot.pixels_mut().chunks_mut(stride as usize).enumerate() {
                for pixel in bytes.chunks_exact_mut(bytes_per_pixel).take(WIDTH as usize) {
                    pixel.copy_from_slice(&(row as u16).to_le_bytes()[..bytes_per_pixel]);
                }
            }
            publisher.publish(slot, &FrameHeader::new(WIDTH, HEIGHT, stride, format))?;
            thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    })
}
