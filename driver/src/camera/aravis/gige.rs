//! What GigE Vision needs besides: packets that arrive whole and at once, and frames that do not wait for lost ones.
//!
//! The library can receive in two ways. A plain socket hands over every packet as it comes, and holds what the kernel allows. A packet
//! socket (CAP_NET_RAW) holds 32 MB, but hands over blocks of 2 MB or what came within 5 ms (packet(7), TPACKET_V3): a frame ends
//! up to 5 ms late. So it is the plain socket wherever the kernel lets it hold enough frames.

use std::net::{Ipv4Addr, UdpSocket};

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{
    GvInterface, GvPacketSizeAdjustment, GvStream, GvStreamOption, GvStreamPacketResend,
    GvStreamSocketBuffer, Interface, Stream,
};
use rustix::net::sockopt;
use rustix::thread::CapabilitySet;
use tracing::warn;

use crate::camera::SOCKET_FRAMES;
use crate::realtime;
use crate::told::OPENING;

/// How long a frame may lack a packet while no other frame begins, microseconds. Long enough for a busy sender: a frame is over
/// anyway with the first packet of the next one, so no frame waits for it.
const FRAME_RETENTION_US: u32 = 500_000;
/// Frames below which it is not trusted: 33 ms at 60 fps, longer than a busy system keeps a thread waiting.
const FEWEST_FRAMES: usize = 2;

/// How the library receives packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Socket {
    Plain,
    Packet,
}

/// The library's interface to GigE Vision; none where this program may not make internet sockets, as in a service without network:
/// the library takes them for granted, and would end the program.
pub(super) fn interface() -> Option<Interface> {
    UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    GvInterface::instance()
}

/// Before the stream is made: chooses the socket, and lets the library find the largest packet that passes the network without being
/// split, by trial where the device can send test packets.
pub(super) fn prepare(camera: &aravis::Camera, serial: &str, payload_bytes: usize) {
    camera.gv_set_packet_size_adjustment(GvPacketSizeAdjustment::Once);
    let wanted_bytes = SOCKET_FRAMES * payload_bytes;
    let allowed_bytes = allowed_buffer(wanted_bytes);
    let socket = choose(allowed_bytes, payload_bytes, realtime::has(CapabilitySet::NET_RAW));
    let remedy = format!(
        "the kernel limits socket buffers to {allowed_bytes} bytes, {SOCKET_FRAMES} frames need {wanted_bytes}: sysctl -w \
         net.core.rmem_max={wanted_bytes}"
    );
    match socket {
        Socket::Packet => {
            warn!(target: OPENING, "camera {serial}: frames arrive up to 5 ms late, through a packet socket; {remedy}")
        }
        Socket::Plain if allowed_bytes < wanted_bytes => {
            warn!(target: OPENING, "camera {serial}: frames can be lost under load; {remedy}");
        }
        Socket::Plain => {}
    }
    camera.gv_set_stream_options(match socket {
        Socket::Plain => GvStreamOption::PACKET_SOCKET_DISABLED,
        Socket::Packet => GvStreamOption::NONE,
    });
}

fn choose(allowed_bytes: usize, payload_bytes: usize, may_open_packet_sockets: bool) -> Socket {
    match may_open_packet_sockets && allowed_bytes < FEWEST_FRAMES * payload_bytes {
        true => Socket::Packet,
        false => Socket::Plain,
    }
}

/// What the kernel makes of a receive buffer of `wanted_bytes`: it cuts the size down without saying so (net.core.rmem_max).
fn allowed_buffer(wanted_bytes: usize) -> usize {
    let asked = || -> std::io::Result<usize> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        sockopt::set_socket_recv_buffer_size(&socket, wanted_bytes)?;
        // The kernel doubles what it grants, for its own bookkeeping (socket(7)).
        Ok(sockopt::socket_recv_buffer_size(&socket)? / 2)
    };
    // Where even that fails, nothing is known against it.
    asked().unwrap_or(wanted_bytes)
}

/// After the stream is made, before its first frame. Does nothing to a stream of another transport.
///
/// The library gives its socket the size when the first packet arrives. Until then it has the kernel's (net.core.rmem_default), so
/// that the first frame of a stream can be lost on a busy machine, before anyone counts.
pub(super) fn tune(stream: &Stream, payload_bytes: usize) {
    let Some(stream) = stream.downcast_ref::<GvStream>() else { return };
    // A packet asked for again would hold back the frames after it.
    stream.set_packet_resend(GvStreamPacketResend::Never);
    stream.set_frame_retention(FRAME_RETENTION_US);
    stream.set_socket_buffer(GvStreamSocketBuffer::Fixed);
    stream.set_socket_buffer_size(i32::try_from(SOCKET_FRAMES * payload_bytes).unwrap_or(i32::MAX));
}

/// Bytes of the packets that frames come in (GevSCPSPacketSize), headers included; nothing for another transport.
pub(super) fn packet_bytes(camera: &aravis::Camera) -> Option<u32> {
    camera.is_gv_device().then(|| camera.gv_get_packet_size().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_packet_socket_is_for_kernels_that_allow_too_little() {
        assert_eq!(choose(4 << 20, 752 * 480, true), Socket::Plain);
        assert_eq!(choose(212_992, 752 * 480, true), Socket::Packet);
        assert_eq!(choose(212_992, 752 * 480, false), Socket::Plain);
        assert_eq!(choose(212_992, 320 * 200, true), Socket::Plain);
    }

    #[test]
    fn a_small_buffer_is_allowed_and_a_large_one_up_to_the_limit() {
        assert_eq!(allowed_buffer(100_000), 100_000);
        assert!((100_000..=1 << 30).contains(&allowed_buffer(1 << 30)));
    }
}
