//! Saves frames as PNG files, on a thread of its own so that the consumer keeps up with the camera.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use uvcam_shm_ipc::{Frame, PixelFormat};

use crate::error::Error;

/// Frames that may wait for the disk.
const WAITING: usize = 64;

/// The saving thread, and the way to it.
pub(super) struct Saver {
    folder: PathBuf,
    pictures: SyncSender<Picture>,
    thread: JoinHandle<Result<(), Error>>,
}

struct Picture {
    path: PathBuf,
    width: u32,
    height: u32,
    pixels: Vec<u8>,
    color: ExtendedColorType,
}

impl Saver {
    /// Makes the folder where it is missing.
    pub(super) fn new(folder: &Path) -> Result<Self, Error> {
        let failed = |doing| move |source| Error::System { doing, path: folder.into(), source };
        std::fs::create_dir_all(folder).map_err(failed("making folder"))?;
        let (pictures, inbox) = sync_channel(WAITING);
        let thread = std::thread::Builder::new()
            .name("save".into())
            .spawn(move || write_all(&inbox))
            .map_err(failed("starting the thread that saves to"))?;
        Ok(Saver { folder: folder.into(), pictures, thread })
    }

    /// Copies the frame; it is written as `EPOCH_FRAMEID.png`, counted from 1 and by the device.
    pub(super) fn save(&self, epoch: u64, frame: &Frame) {
        let header = frame.header();
        let format = header.pixel_format().unwrap_or(PixelFormat::Mono8);
        let wide = format.bytes_per_pixel() == 2;
        let row_bytes = header.width as usize * format.bytes_per_pixel();
        let mut pixels = Vec::with_capacity(row_bytes * header.height as usize);
        for row in frame.pixels().chunks(header.stride as usize).take(header.height as usize) {
            let row = row.get(..row_bytes).unwrap_or(row);
            if wide {
                // A PNG of 16 bits uses the whole range.
                let shift = 16 - format.significant_bits();
                let values =
                    row.chunks_exact(2).map(|pixel| u16::from_le_bytes([pixel[0], pixel[1]]) << shift);
                pixels.extend(values.flat_map(u16::to_ne_bytes));
            } else {
                pixels.extend_from_slice(row);
            }
        }
        let path = self.folder.join(format!("{epoch:02}_{:08}.png", header.device_frame_id));
        let color = if wide { ExtendedColorType::L16 } else { ExtendedColorType::L8 };
        // The thread is gone only where it could not write; `finish` tells why.
        let _ =
            self.pictures.send(Picture { path, width: header.width, height: header.height, pixels, color });
    }

    /// Waits until everything is on its way to the disk.
    pub(super) fn finish(self) -> Result<(), Error> {
        drop(self.pictures);
        let source = || std::io::Error::other("the saving thread panicked");
        self.thread.join().unwrap_or_else(|_| {
            Err(Error::System { doing: "saving to", path: self.folder.clone(), source: source() })
        })
    }
}

fn write_all(inbox: &Receiver<Picture>) -> Result<(), Error> {
    for picture in inbox {
        let Picture { path, width, height, pixels, color } = picture;
        let failed = |source| Error::System { doing: "writing", path: path.clone(), source };
        let file = BufWriter::new(File::create(&path).map_err(failed)?);
        PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive)
            .write_image(&pixels, width, height, color)
            .map_err(|error| failed(std::io::Error::other(error)))?;
    }
    Ok(())
}
