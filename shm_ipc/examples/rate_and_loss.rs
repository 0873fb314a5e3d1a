//! Says every second how many frames came, and how many did not: `rate_and_loss [CAMERA [PREFIX ROOT_PATH]]`.

use std::time::{Duration, Instant};

use uvcam_shm_ipc::{IpcError, Settings, Subscriber};

fn main() -> Result<(), IpcError> {
    let mut words = std::env::args().skip(1);
    let mut word = |default: &str| words.next().unwrap_or_else(|| default.to_owned());
    let (camera, settings) = (word("left"), Settings::new(word("uvcam_"), word("/tmp/uvcam")));

    let mut subscriber = Subscriber::open(&settings, &camera)?;
    let (mut since, mut frames, mut lost) = (Instant::now(), 0, 0);
    loop {
        subscriber.wait(Duration::from_millis(100))?;
        while let Some(frame) = subscriber.receive()? {
            frames += 1;
            lost += frame.lost_before();
            if frame.epoch_changed() {
                println!("{camera}: driver or camera started anew");
            }
        }
        let seconds = since.elapsed().as_secs_f64();
        if seconds >= 1.0 {
            println!("{camera}: {:.1} frames a second, {lost} lost", frames as f64 / seconds);
            (since, frames, lost) = (Instant::now(), 0, 0);
        }
    }
}
