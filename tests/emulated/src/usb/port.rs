//! A port of the kernel's virtual USB controller, with a device in it.

use std::fs;
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::endpoints::Endpoints;
use super::{Device, usbip};
use crate::wait_until;

/// The controller (Documentation/usb/usbip_protocol.rst and drivers/usb/usbip/vhci_sysfs.c of the kernel).
const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";
/// State of a port without a device.
const FREE: &str = "004";

/// How fast a device's link is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// USB 2.0, 480 Mbit/s.
    High,
    /// USB 3.0, 5 Gbit/s.
    Super,
}

impl Speed {
    /// Bytes of a whole packet on a bulk endpoint.
    pub fn bulk_packet(self) -> u16 {
        match self {
            Speed::High => 512,
            Speed::Super => 1024,
        }
    }

    /// The hub of the controller, and the kernel's number of the speed.
    fn hub(self) -> (&'static str, u8) {
        match self {
            Speed::High => ("hs", 3),
            Speed::Super => ("ss", 5),
        }
    }
}

/// A device in a port. Dropping it pulls the plug.
pub struct Plugged<D: Device> {
    device: Arc<Mutex<D>>,
    socket: UnixStream,
    server: Option<JoinHandle<()>>,
    port: String,
}

impl<D: Device> Plugged<D> {
    /// Plugs the device into a free port.
    ///
    /// # Panics
    /// Where the module vhci-hcd is not loaded, every port is taken, or the caller is not root.
    pub fn new(device: D) -> Self {
        let (hub, speed) = device.descriptors().speed.hub();
        let (ours, kernels) = UnixStream::pair().unwrap();
        let port = free_port(hub);
        let socket = ours.try_clone().unwrap();
        let device = Arc::new(Mutex::new(device));
        let server = {
            let device = Arc::clone(&device);
            std::thread::spawn(move || serve(&device, ours))
        };
        // Port, socket, bus and device number (any but 0), speed.
        let order = format!("{port} {} 65537 {speed}", kernels.as_raw_fd());
        fs::write(format!("{CONTROLLER}/attach"), &order)
            .unwrap_or_else(|error| panic!("attach {order}: {error}"));
        Plugged { device, socket, server: Some(server), port }
    }

    /// The device, between two messages of its controller.
    pub fn device(&self) -> MutexGuard<'_, D> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pulls the plug, and returns when the kernel has noticed.
    pub fn unplug(self) {}
}

impl<D: Device> Drop for Plugged<D> {
    fn drop(&mut self) {
        let _ = self.socket.shutdown(Shutdown::Both);
        if let Some(server) = self.server.take() {
            let _ = server.join();
        }
        let port = &self.port;
        wait_until("the port is free", || ports().iter().any(|found| found.number == *port && found.is_free));
    }
}

/// Speaks for the device until the plug is pulled.
fn serve<D: Device>(device: &Mutex<D>, mut socket: UnixStream) {
    let mut endpoints = Endpoints::default();
    let mut turn = |socket: &mut UnixStream| {
        let due = {
            let mut device = device.lock().unwrap_or_else(PoisonError::into_inner);
            let due = device.elapse(Instant::now());
            endpoints.send(&mut *device, socket)?;
            due
        };
        let patience = due.map(|due| due.saturating_duration_since(Instant::now()));
        if is_readable(socket, patience)? {
            let message = usbip::receive(socket)?;
            let mut device = device.lock().unwrap_or_else(PoisonError::into_inner);
            endpoints.handle(message, &mut *device, socket)?;
        }
        std::io::Result::Ok(())
    };
    // The end of the connection is the end of the device.
    while turn(&mut socket).is_ok() {}
}

fn is_readable(socket: &UnixStream, patience: Option<Duration>) -> rustix::io::Result<bool> {
    let timeout = patience.and_then(|patience| Timespec::try_from(patience).ok());
    poll(&mut [PollFd::new(socket, PollFlags::IN)], timeout.as_ref()).map(|ready| ready > 0)
}

struct Port {
    hub: String,
    number: String,
    is_free: bool,
}

fn free_port(hub: &str) -> String {
    let port = ports().into_iter().find(|port| port.hub == hub && port.is_free);
    port.unwrap_or_else(|| panic!("no free port at {hub}")).number
}

/// Every port: a line `hub port state ...` each, behind a heading.
fn ports() -> Vec<Port> {
    let path = format!("{CONTROLLER}/status");
    let status =
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}; load the module vhci-hcd"));
    let lines = status.lines().skip(1).map(|line| line.split_whitespace());
    lines
        .filter_map(|mut words| {
            let (hub, number, state) = (words.next()?, words.next()?, words.next()?);
            Some(Port { hub: hub.into(), number: number.into(), is_free: state == FREE })
        })
        .collect()
}
