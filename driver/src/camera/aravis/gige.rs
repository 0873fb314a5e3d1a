//! What GigE Vision needs besides: packets that arrive whole, and frames that do not wait for lost ones.

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{GvPacketSizeAdjustment, GvStream, GvStreamPacketResend, GvStreamSocketBuffer, Stream};
use tracing::warn;

/// How long a frame is kept open after its last packet, microseconds. Only the last frame before a pause lives that long: any
/// other ends with the first packet of the next one.
const FRAME_RETENTION_US: u32 = 500_000;
/// Frames that the socket holds while the receiving thread does not run.
const SOCKET_FRAMES: usize = 2;
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
    let allowed = std::fs::read_to_string(RMEM_MAX).ok().and_then(|text| text.trim().parse::<usize>().ok());
    if let Some(allowed) = allowed.filter(|allowed| *allowed < wanted) {
        warn!(
            "camera {serial}: the socket buffer is limited to {allowed} bytes, {SOCKET_FRAMES} frames need {wanted}; \
             without CAP_NET_RAW frames can be lost: sysctl -w net.core.rmem_max={wanted}"
        );
    }
}
