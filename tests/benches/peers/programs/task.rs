//! What a peer is started with, and how it ends.
//!
//! `PROGRAM WAY FOLDER WIDTH HEIGHT CAMERAS SECONDS`: the way tells chain and side; the folder holds `frames.raw` (pictures of
//! `WIDTH` x `HEIGHT` px, Mono8, one after the other) and `mask.raw` (one picture, 0 = discard, 255 = keep), and is the place for
//! sockets and service files. A peer runs until its standard input ends, so that none outlives the bench.

use std::io::Read;
use std::path::PathBuf;

/// One side of a chain.
pub struct Task {
    /// Where pictures and mask lie.
    pub folder: PathBuf,
    /// Pixels in a row, and bytes.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How many cameras there are.
    pub cameras: usize,
    /// How long a consumer measures, seconds.
    pub seconds: f64,
}

impl Task {
    /// Reads the command line: the way, and the rest.
    pub fn from_arguments() -> (String, Task) {
        let words: Vec<String> = std::env::args().skip(1).collect();
        let [way, folder, width, height, cameras, seconds] = words.as_slice() else {
            panic!("usage: PROGRAM WAY FOLDER WIDTH HEIGHT CAMERAS SECONDS")
        };
        let task = Task {
            folder: folder.into(),
            width: width.parse().unwrap(),
            height: height.parse().unwrap(),
            cameras: cameras.parse().unwrap(),
            seconds: seconds.parse().unwrap(),
        };
        (way.clone(), task)
    }

    /// Bytes of a frame.
    pub fn frame_bytes(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The mask: 0 = discard, 255 = keep.
    pub fn mask(&self) -> Vec<u8> {
        let mask = std::fs::read(self.folder.join("mask.raw")).unwrap();
        assert_eq!(mask.len(), self.frame_bytes(), "mask.raw");
        mask
    }
}

/// Waits until the bench closes standard input.
pub fn wait_for_end() {
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
}
