//! `uvcam watch`: a consumer like any other, that reports what arrived.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use uvcam_masker::{ImageView, Mask};
use uvcam_shm_ipc::{Frame, Subscriber, monotonic_ns};

use crate::args;
use crate::config::Config;
use crate::error::Error;
use crate::exit::Exit;
use crate::log;

mod report;
mod save;

use report::Tally;
use save::Saver;

/// Longest sleep before the command looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(100);
/// When to say that nothing comes.
const IMPATIENCE: Duration = Duration::from_secs(2);

pub(super) fn execute(arguments: &args::Watch, config: &Config) -> Result<Exit, Error> {
    let mask = arguments.mask.as_deref().map(Mask::load).transpose().map_err(Error::MaskFile)?;
    let saver = arguments.save.as_deref().map(Saver::new).transpose()?;
    let stop = super::stop_flag()?;
    let mut subscriber = Subscriber::open(&config.ipc.settings, &arguments.camera)?;
    let mut tally = Tally::new(&arguments.camera, mask.is_some());
    let silence = Silence::new(arguments.timeout.map(Duration::from_secs_f64));
    let gave_up =
        watch(arguments.frames, mask.as_ref(), saver.as_ref(), &stop, &mut subscriber, &mut tally, silence)?;
    if let Some(saver) = saver {
        saver.finish()?;
    }
    tally.finish(&subscriber);
    super::print(&if arguments.json { tally.json() } else { tally.table() })?;
    if tally.masked_nonzero > 0 {
        tracing::error!("{}: {} masked pixels are not black", arguments.camera, tally.masked_nonzero);
        return Ok(Exit::Refused);
    }
    Ok(if gave_up { Exit::SharedMemory } else { Exit::Done })
}

/// Reads frames until enough came or `stop` is set. Returns whether it gave up for want of frames.
fn watch(
    frames: Option<u64>,
    mask: Option<&Mask>,
    saver: Option<&Saver>,
    stop: &AtomicBool,
    subscriber: &mut Subscriber,
    tally: &mut Tally,
    mut silence: Silence,
) -> Result<bool, Error> {
    let enough = |tally: &Tally| frames.is_some_and(|frames| tally.frames >= frames);
    let mut status = Status(Instant::now());
    // Relaxed: the flag carries no data, and is seen within one `PATIENCE`.
    while !stop.load(Ordering::Relaxed) {
        subscriber.wait(PATIENCE)?;
        while let Some(frame) = subscriber.receive()? {
            let received_ns = monotonic_ns();
            silence.broken();
            tally.add(frame.header(), received_ns, masked_nonzero(mask, &frame)?);
            if let Some(saver) = saver {
                saver.save(subscriber.epochs(), &frame);
            }
            if enough(tally) {
                return Ok(false);
            }
        }
        status.show(tally, subscriber);
        if silence.too_long(&tally.camera) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn masked_nonzero(mask: Option<&Mask>, frame: &Frame) -> Result<u64, Error> {
    let Some(mask) = mask else { return Ok(0) };
    let header = frame.header();
    let bytes_per_pixel = header.pixel_format()?.bytes_per_pixel();
    let image =
        ImageView::new(frame.pixels(), header.width, header.height, header.stride as usize, bytes_per_pixel)?;
    Ok(mask.masked_nonzero(&image)?)
}

/// How long nothing has come, and what to make of it.
struct Silence {
    since: Instant,
    said: bool,
    limit: Option<Duration>,
}

impl Silence {
    fn new(limit: Option<Duration>) -> Self {
        Silence { since: Instant::now(), said: false, limit }
    }

    fn broken(&mut self) {
        self.since = Instant::now();
        self.said = false;
    }

    fn too_long(&mut self, camera: &str) -> bool {
        let silent = self.since.elapsed();
        if silent >= IMPATIENCE && !self.said {
            self.said = true;
            tracing::warn!(
                "{camera}: no frame for {} s; is `uvcam run` running, with a camera of this name and the same [ipc] settings?",
                IMPATIENCE.as_secs()
            );
        }
        self.limit.is_some_and(|limit| silent >= limit)
    }
}

/// When the status line is shown next.
struct Status(Instant);

impl Status {
    fn show(&mut self, tally: &Tally, subscriber: &Subscriber) {
        if Instant::now() >= self.0 {
            self.0 += Duration::from_millis(500);
            log::show_status(&tally.line(subscriber));
        }
    }
}
