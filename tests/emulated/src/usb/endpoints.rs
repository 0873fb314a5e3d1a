//! What lies between a device and the messages of its controller: standard requests, halted endpoints, transfers in pieces.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};

use super::usbip::{self, ECONNRESET, EOVERFLOW, EPIPE, Message, OK, Submit};
use super::{Bytes, Device, Setup, Stall};

/// Standard requests (USB 3.2, table 9-5) that are more than taken note of.
const GET_STATUS: u8 = 0;
const CLEAR_FEATURE: u8 = 1;
const SET_FEATURE: u8 = 3;
const GET_DESCRIPTOR: u8 = 6;
const GET_CONFIGURATION: u8 = 8;
const GET_INTERFACE: u8 = 10;
/// Recipient of a request: an endpoint, which its index names.
const ENDPOINT: u8 = 2;

/// The endpoints of one device.
#[derive(Default)]
pub(super) struct Endpoints {
    reading: BTreeMap<u8, Reading>,
}

/// One bulk endpoint that the host reads.
#[derive(Default)]
struct Reading {
    /// Number and length of what the host asks for, in its order.
    asked: VecDeque<(u32, usize)>,
    /// What the device still has to send of its present transfer.
    rest: Option<Bytes>,
    halted: bool,
}

impl Endpoints {
    /// Handles one message; what can be answered at once is.
    pub(super) fn handle(
        &mut self,
        message: Message,
        device: &mut impl Device,
        socket: &mut impl Write,
    ) -> io::Result<()> {
        match message {
            Message::Unlink(number, asked) => {
                let was_waiting = self.reading.values_mut().any(|endpoint| {
                    let before = endpoint.asked.len();
                    endpoint.asked.retain(|(number, _)| *number != asked);
                    endpoint.asked.len() != before
                });
                usbip::answer_unlink(socket, number, if was_waiting { ECONNRESET } else { OK })
            }
            Message::Submit(submit) if submit.endpoint == 0 => self.control(&submit, device, socket),
            Message::Submit(submit) if submit.is_in => {
                let endpoint = self.reading.entry(submit.endpoint).or_default();
                endpoint.asked.push_back((submit.number, submit.length));
                Ok(())
            }
            Message::Submit(submit) => {
                let status = if device.write(submit.endpoint, &submit.data).is_ok() { OK } else { EPIPE };
                usbip::answer(socket, submit.number, status, submit.data.len(), &[])
            }
        }
    }

    fn control(
        &mut self,
        submit: &Submit,
        device: &mut impl Device,
        socket: &mut impl Write,
    ) -> io::Result<()> {
        let answer = match submit.setup.is_standard() {
            true => self.standard(submit.setup, device),
            false => device.control(submit.setup, &submit.data),
        };
        match answer {
            Ok(mut data) if submit.is_in => {
                data.truncate(submit.length);
                usbip::answer(socket, submit.number, OK, data.len(), &data)
            }
            Ok(_) => usbip::answer(socket, submit.number, OK, submit.data.len(), &[]),
            Err(Stall) => usbip::answer(socket, submit.number, EPIPE, 0, &[]),
        }
    }

    fn standard(&mut self, setup: Setup, device: &mut impl Device) -> Result<Vec<u8>, Stall> {
        match setup.request {
            GET_DESCRIPTOR => device.descriptors().get(setup.value).ok_or(Stall),
            GET_STATUS => Ok(vec![0, 0]),
            GET_CONFIGURATION => Ok(vec![1]),
            GET_INTERFACE => Ok(vec![0]),
            CLEAR_FEATURE | SET_FEATURE if setup.request_type == ENDPOINT => {
                let address = setup.index as u8;
                if address & 0x80 != 0 {
                    let endpoint = self.reading.entry(address & 0x0f).or_default();
                    endpoint.halted = setup.request == SET_FEATURE;
                    endpoint.rest = None;
                }
                device.reset(address & 0x0f);
                Ok(Vec::new())
            }
            // Configuration, interface, isochronous delay, exit latencies: nothing depends on them.
            _ if !setup.is_in() => Ok(Vec::new()),
            _ => Err(Stall),
        }
    }

    /// Sends what the device has and the host asks for.
    pub(super) fn send(&mut self, device: &mut impl Device, socket: &mut impl Write) -> io::Result<()> {
        let packet = usize::from(device.descriptors().speed.bulk_packet());
        for (address, endpoint) in &mut self.reading {
            while let Some(&(number, length)) = endpoint.asked.front() {
                if !endpoint.halted && endpoint.rest.is_none() {
                    match device.read(*address) {
                        Ok(Some(transfer)) => endpoint.rest = Some(transfer),
                        Ok(None) => break,
                        Err(Stall) => endpoint.halted = true,
                    }
                }
                endpoint.asked.pop_front();
                match endpoint.rest.take_if(|_| !endpoint.halted) {
                    None => usbip::answer(socket, number, EPIPE, 0, &[])?,
                    Some(whole) if whole.len() <= length => {
                        usbip::answer(socket, number, OK, whole.len(), &whole)?;
                    }
                    // A host that asks for whole packets gets the rest with its next question.
                    Some(mut rest) if length.is_multiple_of(packet) => {
                        let piece = rest.split(length);
                        endpoint.rest = Some(rest);
                        usbip::answer(socket, number, OK, length, &piece)?;
                    }
                    // A packet is longer than the place for it; what the device sends goes nowhere. Never answer with more than
                    // was asked: Linux 6.1 does not survive it.
                    Some(_) => usbip::answer(socket, number, EOVERFLOW, 0, &[])?,
                }
            }
        }
        Ok(())
    }
}
