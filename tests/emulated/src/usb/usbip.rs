//! Messages of USB/IP, version 1.1.1 (Documentation/usb/usbip_protocol.rst of the kernel). Every field is big-endian.

use std::io::{self, IoSlice, Read, Write};

use super::Setup;

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMIT_ANSWER: u32 = 3;
const UNLINK_ANSWER: u32 = 4;
const HEADER: usize = 48;

/// Outcomes of a transfer, as the kernel numbers them.
pub(super) const OK: i32 = 0;
pub(super) const EPIPE: i32 = -32;
pub(super) const EOVERFLOW: i32 = -75;
pub(super) const ECONNRESET: i32 = -104;

/// What the controller asks.
#[derive(Debug)]
pub(super) enum Message {
    /// Do a transfer.
    Submit(Submit),
    /// Forget the transfer with the second number; the first is the message's own.
    Unlink(u32, u32),
}

/// A transfer.
#[derive(Debug)]
pub(super) struct Submit {
    pub(super) number: u32,
    /// Without the bit of direction.
    pub(super) endpoint: u8,
    pub(super) is_in: bool,
    /// How many bytes the host reads at most.
    pub(super) length: usize,
    pub(super) setup: Setup,
    /// What the host writes.
    pub(super) data: Vec<u8>,
}

/// Reads one message.
pub(super) fn receive(socket: &mut impl Read) -> io::Result<Message> {
    let mut header = [0; HEADER];
    socket.read_exact(&mut header)?;
    let word = |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let number = word(4);
    match word(0) {
        SUBMIT => {
            let is_in = word(12) == 1;
            let length = word(24) as usize;
            let mut setup = [0; 8];
            setup.copy_from_slice(&header[40..48]);
            let mut data = vec![0; if is_in { 0 } else { length }];
            socket.read_exact(&mut data)?;
            let setup = Setup::parse(setup);
            Ok(Message::Submit(Submit { number, endpoint: word(16) as u8, is_in, length, setup, data }))
        }
        UNLINK => Ok(Message::Unlink(number, word(20))),
        other => Err(io::Error::new(io::ErrorKind::InvalidData, format!("message of kind {other}"))),
    }
}

/// Answers a transfer. `length` is what was transferred, in either direction; it must not exceed what was asked, and is not 0
/// where `data` follows.
pub(super) fn answer(
    socket: &mut impl Write,
    number: u32,
    status: i32,
    length: usize,
    data: &[u8],
) -> io::Result<()> {
    let mut header = head(SUBMIT_ANSWER, number, status);
    header[24..28].copy_from_slice(&(length as u32).to_be_bytes());
    let mut slices = [IoSlice::new(&header), IoSlice::new(data)];
    let mut slices = &mut slices[..];
    while !slices.is_empty() {
        let written = socket.write_vectored(slices)?;
        IoSlice::advance_slices(&mut slices, written);
    }
    Ok(())
}

/// Answers a wish to forget.
pub(super) fn answer_unlink(socket: &mut impl Write, number: u32, status: i32) -> io::Result<()> {
    socket.write_all(&head(UNLINK_ANSWER, number, status))
}

fn head(kind: u32, number: u32, status: i32) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[0..4].copy_from_slice(&kind.to_be_bytes());
    header[4..8].copy_from_slice(&number.to_be_bytes());
    header[20..24].copy_from_slice(&status.to_be_bytes());
    header
}
