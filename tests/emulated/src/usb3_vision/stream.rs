//! Frames on their way to the host: a leader, the pixels, a trailer (USB3 Vision 1.1, chapter 5), each a transfer of its own.

use std::collections::VecDeque;

use crate::scene::picture;
use crate::usb::Bytes;

pub(super) const LEADER_BYTES: usize = 52;
pub(super) const TRAILER_BYTES: usize = 32;
/// Frames that the camera keeps for a host that is late. What comes after them is lost.
const MEMORY_FRAMES: usize = 4;
/// What a frame is, besides its pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) id: u64,
    pub(super) timestamp_ns: u64,
    pub(super) pixel_format: u32,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) offset_x: u32,
    pub(super) offset_y: u32,
    pub(super) payload_bytes: usize,
}

/// What is wrong with one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Defect {
    None,
    /// Half of the pixels.
    Short,
    /// The end is missing.
    NoTrailer,
}

/// Transfers that wait for the host.
#[derive(Default)]
pub(super) struct Stream {
    /// Frames, oldest first, as what is left of their transfers.
    frames: VecDeque<VecDeque<Bytes>>,
}

impl Stream {
    /// Takes a frame, or loses it where the memory is full.
    pub(super) fn push(&mut self, frame: &Frame, defect: Defect) {
        if self.frames.len() >= MEMORY_FRAMES {
            return;
        }
        let mut pixels = picture(frame.id, frame.payload_bytes);
        if defect == Defect::Short {
            pixels.truncate(frame.payload_bytes / 2);
        }
        let mut transfers = VecDeque::from([leader(frame).into(), pixels]);
        if defect != Defect::NoTrailer {
            transfers.push_back(trailer(frame).into());
        }
        self.frames.push_back(transfers);
    }

    /// The next transfer.
    pub(super) fn pop(&mut self) -> Option<Bytes> {
        let transfers = self.frames.front_mut()?;
        let next = transfers.pop_front();
        if transfers.is_empty() {
            self.frames.pop_front();
        }
        next
    }

    pub(super) fn clear(&mut self) {
        self.frames.clear();
    }
}

fn head(prefix: &[u8; 4], bytes: usize, id: u64) -> Vec<u8> {
    let mut head = prefix.to_vec();
    head.extend([0, 0]);
    head.extend((bytes as u16).to_le_bytes());
    head.extend(id.to_le_bytes());
    head
}

fn leader(frame: &Frame) -> Vec<u8> {
    let mut leader = head(b"U3VL", LEADER_BYTES, frame.id);
    // Reserved; payload type 1, an image.
    leader.extend([0, 0, 1, 0]);
    leader.extend(frame.timestamp_ns.to_le_bytes());
    for word in [frame.pixel_format, frame.width, frame.height, frame.offset_x, frame.offset_y] {
        leader.extend(word.to_le_bytes());
    }
    // Padding of a row, reserved.
    leader.extend([0; 4]);
    leader
}

fn trailer(frame: &Frame) -> Vec<u8> {
    let mut trailer = head(b"U3VT", TRAILER_BYTES, frame.id);
    // Status: success.
    trailer.extend([0; 4]);
    trailer.extend((frame.payload_bytes as u64).to_le_bytes());
    trailer.extend(frame.height.to_le_bytes());
    trailer
}
