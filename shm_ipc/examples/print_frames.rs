//! A consumer: prints every frame of one camera until it is stopped.
//!
//! `cargo run -p uvcam-shm-ipc --example print_frames -- CAMERA`

use std::time::Duration;

use uvcam_shm_ipc::{IpcError, Settings, Subscriber, monotonic_ns};

fn main() -> Result<(), IpcError> {
    let camera = std::env::args().nth(1).unwrap_or_else(|| "simulated".to_owned());
    let mut subscriber = Subscriber::open(&Settings::default(), &camera)?;
    loop {
        // Sleeps until the driver sends; without it, `next` polls.
        subscriber.wait(Duration::from_secs(1))?;
        while let Some(frame) = subscriber.next()? {
            if frame.epoch_changed() {
                println!("{camera}: the driver or its camera started anew");
            }
            let header = frame.header();
            println!(
                "{camera}: frame {}, {}x{}, exposed at {:.6} s, {} lost before, brightest pixel {:?}, {} us after it was sent",
                header.sequence,
                header.width,
                header.height,
                header.mid_exposure_realtime_ns as f64 * 1e-9,
                frame.lost_before(),
                frame.pixels().iter().max(),
                monotonic_ns().saturating_sub(header.send_monotonic_ns) / 1000,
            );
        }
    }
}
