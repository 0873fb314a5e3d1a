//! What every emulated camera sees.

use std::sync::{Arc, LazyLock};

use crate::usb::Bytes;

/// Level of the brightest pixel; the darkest is 1, so that no pixel looks masked.
const LEVELS: usize = 251;
const LARGEST_FRAME: usize = 2 * 1920 * 1200;

/// Bands that move by a pixel with each frame.
static SCENE: LazyLock<Arc<[u8]>> =
    LazyLock::new(|| (0..LARGEST_FRAME + LEVELS).map(|at| (1 + at % LEVELS) as u8).collect());

/// Draws the scene, which takes longer than a frame: to be called before the first.
pub(crate) fn prepare() {
    LazyLock::force(&SCENE);
}

/// The bytes of the frame with this id, row by row: byte `i` of frame `k` is `1 + (i + k) % 251`.
pub fn picture(id: u64, bytes: usize) -> Bytes {
    let first = (id % LEVELS as u64) as usize;
    Bytes::part(Arc::clone(&SCENE), first..first + bytes)
}
