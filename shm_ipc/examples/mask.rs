//! The mask beside the frames, told when it changes: `mask [CAMERA [PREFIX ROOT_PATH]]`.

use std::time::Duration;

use uvcam_shm_ipc::{Flags, IpcError, IpcErrorKind, Settings, Subscriber};

fn main() -> Result<(), IpcError> {
    let mut words = std::env::args().skip(1);
    let mut word = |default: &str| words.next().unwrap_or_else(|| default.to_owned());
    let (camera, settings) = (word("left"), Settings::new(word("uvcam_"), word("/tmp/uvcam")));

    let mut subscriber = Subscriber::open(&settings, &camera)?;
    let mut last = None;
    loop {
        subscriber.wait(Duration::from_secs(1))?;
        while let Some(frame) = subscriber.receive()? {
            let mask = match subscriber.mask_of(&frame) {
                // It comes soon; a frame without its mask is not for whoever needs one.
                Err(error) if error.kind() == IpcErrorKind::MaskPending => continue,
                mask => mask?,
            };
            if last.replace(frame.header().mask_id) == Some(frame.header().mask_id) {
                continue;
            }
            let Some(mask) = mask else {
                println!("{camera}: no mask");
                continue;
            };
            let id: String = mask.id().iter().map(|byte| format!("{byte:02x}")).collect();
            let done = if frame.header().flags.contains(Flags::MASKED) { "blanked" } else { "attached" };
            // Where a filter that looks 5 pixels around sees neither the airframe nor the edge of a black area.
            let clear = mask.grown(5).iter().filter(|pixel| **pixel == 255).count();
            println!("{camera}: mask {id}, {done}: {} px, {clear} px stay clear of it", mask.masked_px());
            println!("{camera}: from {}", mask.provenance());
        }
    }
}
