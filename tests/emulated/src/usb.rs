//! A USB device that is a program: plugged into the kernel's virtual controller `vhci_hcd`, seen by every driver and library as if
//! it hung on a cable.
//!
//! [`Plugged`] connects a [`Device`] with a port of the controller. The two speak USB/IP over a pair of sockets: there is no
//! network, and the kernel's side is unmodified.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

pub mod descriptors;
mod endpoints;
mod port;
mod usbip;

pub use descriptors::Descriptors;
pub use port::{Plugged, Speed};

/// What a device does; its port answers standard requests and counts packets.
pub trait Device: Send + 'static {
    /// What it tells about itself when it is plugged in.
    fn descriptors(&self) -> Descriptors;

    /// Answers a class or vendor request on the control endpoint with the bytes that the host reads; `data` is what it wrote.
    ///
    /// # Errors
    /// [`Stall`]: the request is refused.
    fn control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall>;

    /// Takes what the host wrote to a bulk endpoint.
    ///
    /// # Errors
    /// [`Stall`]: the endpoint halts.
    fn write(&mut self, endpoint: u8, data: &[u8]) -> Result<(), Stall>;

    /// The next transfer of a bulk endpoint, to be read by the host; nothing where the host has to wait.
    ///
    /// # Errors
    /// [`Stall`]: the endpoint halts.
    fn read(&mut self, endpoint: u8) -> Result<Option<Bytes>, Stall>;

    /// The host has reset an endpoint: what was under way there is void.
    fn reset(&mut self, endpoint: u8);

    /// Does what is due by `now`, and tells when something is due next.
    fn elapse(&mut self, now: Instant) -> Option<Instant>;
}

/// A request that a device refuses, or an endpoint that it halts (USB 3.2, 8.5.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stall;

/// The setup packet of a control transfer (USB 3.2, table 9-3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setup {
    /// Direction, type and recipient.
    pub request_type: u8,
    /// Which request.
    pub request: u8,
    /// Its parameter.
    pub value: u16,
    /// Interface or endpoint, or another parameter.
    pub index: u16,
    /// How many bytes follow at most.
    pub length: u16,
}

impl Setup {
    /// From the 8 bytes on the wire.
    pub fn parse(bytes: [u8; 8]) -> Self {
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Setup { request_type: bytes[0], request: bytes[1], value: word(2), index: word(4), length: word(6) }
    }

    /// Whether the host reads.
    pub fn is_in(&self) -> bool {
        self.request_type & 0x80 != 0
    }

    /// Whether it is a request that every device has to answer, rather than one of a class or vendor.
    pub fn is_standard(&self) -> bool {
        self.request_type & 0x60 == 0
    }
}

/// Bytes that several transfers may share.
#[derive(Debug, Clone)]
pub struct Bytes {
    whole: Arc<[u8]>,
    range: Range<usize>,
}

impl Bytes {
    /// A part of `whole`.
    pub fn part(whole: Arc<[u8]>, range: Range<usize>) -> Self {
        Bytes { whole, range }
    }

    /// Cuts off the first `length` bytes.
    pub fn split(&mut self, length: usize) -> Bytes {
        let at = self.range.start + length;
        let first = Bytes { whole: Arc::clone(&self.whole), range: self.range.start..at };
        self.range.start = at;
        first
    }

    /// Keeps the first `length` bytes.
    pub fn truncate(&mut self, length: usize) {
        self.range.end = self.range.end.min(self.range.start + length);
    }
}

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Self {
        Bytes { range: 0..bytes.len(), whole: bytes.into() }
    }
}

impl std::ops::Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.whole[self.range.clone()]
    }
}
