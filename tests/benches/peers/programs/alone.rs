//! A camera and the mask, in place, with nobody behind: what the mask alone takes, and what a camera made of software costs in every
//! chain.

use std::thread;

use uvcam_masker::{ImageViewMut, Mask};
use uvcam_shm_ipc::monotonic_ns;

use crate::source::Source;
use crate::task::Task;
use crate::window::{Stamps, Window};

/// Frames of memory that are used in turn, as slots are.
const SLOTS: usize = 16;

/// Walks until the bench has had enough.
pub fn run(task: &Task) {
    let window = Window::new(task, true);
    let (width, height) = (task.width, task.height);
    let keep = task.mask();
    let mask = &Mask::from_fn(width, height, |x, y| keep[y as usize * width as usize + x as usize] == 0);
    thread::scope(|scope| {
        for (camera, mut source) in Source::all(task).into_iter().enumerate() {
            let window = &window;
            scope.spawn(move || {
                let mut slots = vec![vec![0; task.frame_bytes()]; SLOTS];
                for slot in (0..SLOTS).cycle().take_while(|_| !window.is_over()) {
                    let pixels = &mut slots[slot];
                    let (sequence, picture) = source.next();
                    pixels.copy_from_slice(picture);
                    let ready_ns = monotonic_ns();
                    let mut image = ImageViewMut::new(pixels, width, height, width as usize, 1).unwrap();
                    mask.apply(&mut image).unwrap();
                    let masked_ns = monotonic_ns();
                    window.received(
                        camera,
                        &Stamps { sequence, ready_ns, send_ns: masked_ns, masked_ns },
                        pixels,
                    );
                }
            });
        }
        window.conduct();
    });
}
