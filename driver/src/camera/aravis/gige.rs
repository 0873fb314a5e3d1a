//! What GigE Vision needs besides: packets that arrive whole, and frames that do not wait for lost ones.
//!
//! The library receives through a packet socket where the program has CAP_NET_RAW, which takes little processor time and holds
//! 32 MB; otherwise through a plain socket, which holds what the kernel allows.

use std::fs;

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{GvPacketSizeAdjustment, GvStream, GvStreamPacketResend, GvStreamSocketBuffer, Stream};
use rustix::thread::CapabilitySet;
use tracing::warn;

use crate::realtime;

/// How long a frame may lack a packet while no other frame begins, microseconds. Long enough for a busy sender: a frame is over
/// anyway with the first packet of the next one, so no frame waits for it.
const FRAME_RETENTION_US: u32 = 500_000;
/// Frames that a plain socket holds while the receiving thread does not run: 130 ms at 60 fps.
const SOCKET_FRAMES: usize = 8;
/// The kernel's bound of a socket buffer.
const RMEM_MAX: &str = "/proc/sys/net/core/rmem_max";

/// Before the stream is made: the largest packet that passes the network without being split is found by trial, where the
/// device can send test packets.
pub(super) fn prepare(camera: &aravis::Camera) {
    camera.gv_set_packet_size_adjustment(GvPacketSizeAdjustment::Once);
}

/// After the stream is made, before its first frame. Does nothing to a stream of another transport.
pub(super) fn tune(stream: &Stream, serial: &str, payload_bytes: usize) {
    let Some(stream) = stream.downcast_ref::<GvStream>() else { return };
    // A packet asked for again would hold back the frames after it.
    stream.set_packet_resend(GvStreamPacketResend::Never);
    stream.set_frame_retention(FRAME_RETENTION_US);
    stream.set_socket_buffer(GvStreamSocketBuffer::Fixed);
    let wanted = SOCKET_FRAMES * payload_bytes;
    stream.set_socket_buffer_size(i32::try_from(wanted).unwrap_or(i32::MAX));
    // The kernel cuts the size down without saying so.
    let allowed = fs::read_to_string(RMEM_MAX).ok().and_then(|text| text.trim().parse::<usize>().ok());
    if let Some(allowed) =
        allowed.filter(|allowed| *allowed < wanted && !realtime::has(CapabilitySet::NET_RAW))
    {
        warn!(
            "camera {serial}: frames can be lost under load: the kernel limits socket buffers to {allowed} bytes, \
             {SOCKET_FRAMES} frames need {wanted}; give the program CAP_NET_RAW, or sysctl -w net.core.rmem_max={wanted}"
        );
    }
}
