//! Publishes what no camera of ours does, for tests of consumers in other languages: `publisher PREFIX ROOT_PATH FORMAT STRIDE`, until its
//! standard input ends. Rows have padding of 255; each pixel is the number of its row. A mask travels beside the frames. `publisher PREFIX
//! ROOT_PATH newer` is the driver of a later version of the contract.

use std::error::Error;
use std::io::Read;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use uvcam_shm_ipc::iceoryx2::prelude::*;
use uvcam_shm_ipc::mask::{MaskPublisher, NewMask, Run};
use uvcam_shm_ipc::{FrameHeader, PixelFormat, Publisher, Settings};

const CAMERA: &str = "padded";
const WIDTH: u32 = 30;
const HEIGHT: u32 = 5;
const MASK: NewMask = NewMask {
    mask_id: [0xa5; 16],
    width: WIDTH,
    height: HEIGHT,
    runs: &[Run { row: 1, start: 4, length: 2 }, Run { row: 3, start: 28, length: 2 }],
    provenance: r#"{"method": "by hand"}"#,
};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    if let [_, prefix, root_path, newer] = words.as_slice()
        && newer == "newer"
    {
        return publish_newer(&Settings::new(prefix, root_path));
    }
    let [_, prefix, root_path, format, stride] = words.as_slice() else {
        return Err(
            "usage: publisher PREFIX ROOT_PATH FORMAT STRIDE, or publisher PREFIX ROOT_PATH newer".into()
        );
    };
    let (format, stride) = (format.parse::<PixelFormat>()?, stride.parse::<u32>()?);
    let settings = Settings::new(prefix, root_path);
    let masks = MaskPublisher::create(&settings, CAMERA, &MASK)?;
    masks.publish(&MASK)?;
    let mut frames = Publisher::create(&settings, CAMERA, (stride * HEIGHT) as usize, 2)?;
    let mut header = FrameHeader::new(WIDTH, HEIGHT, stride, format);
    header.set_attached_mask(MASK.mask_id);
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        scope.spawn(|| {
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            is_over.store(true, Ordering::Relaxed);
        });
        while !is_over.load(Ordering::Relaxed) {
            let mut slot = frames.loan()?;
            slot.pixels_mut().fill(255);
            for (row, bytes) in (0u16..).zip(slot.pixels_mut().chunks_mut(stride as usize)) {
                for pixel in bytes.chunks_exact_mut(format.bytes_per_pixel()).take(WIDTH as usize) {
                    pixel.copy_from_slice(&row.to_le_bytes()[..format.bytes_per_pixel()]);
                }
            }
            frames.publish(slot, &header)?;
            masks.serve_newcomers()?;
            thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    })
}

/// The services and the page of version 9.
fn publish_newer(settings: &Settings) -> Result<(), Box<dyn Error>> {
    drop(Publisher::create(settings, CAMERA, 64, 2)?);
    for file in std::fs::read_dir("/dev/shm")?.flatten() {
        let name = file.file_name().into_string().unwrap_or_default();
        if name.starts_with(&settings.prefix) && name.ends_with(".wake") {
            let mut page = std::fs::read(file.path())?;
            page[4] = 9;
            std::fs::write(file.path(), page)?;
        }
    }
    let node = NodeBuilder::new().config(&settings.to_iceoryx2()?).create::<ipc_threadsafe::Service>()?;
    let name = ServiceName::new(&format!("uvcam/v9/{CAMERA}/frames"))?;
    let _service = node.service_builder(&name).publish_subscribe::<u64>().create()?;
    println!("ready");
    std::io::stdin().read_to_end(&mut Vec::new())?;
    Ok(())
}
