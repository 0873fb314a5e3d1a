//! What GigE Vision cameras need of the network.

use std::net::IpAddr;

use super::machine::Machine;
use super::{Check, Finding, Severity};
use crate::camera::aravis::SOCKET_FRAMES;
use crate::config::{Config, Source};

/// The kernel's bound of a socket buffer.
const RMEM_MAX: &str = "/proc/sys/net/core/rmem_max";

/// Whether a socket holds enough frames of each camera that is configured by its IP address; of others it is not known whether
/// they speak GigE Vision.
pub(super) fn socket_buffer(machine: &Machine, config: &Config) -> Vec<Finding> {
    let by_address = config.cameras.iter().filter(
        |camera| matches!(&camera.source, Source::Aravis { serial } if serial.parse::<IpAddr>().is_ok()),
    );
    let needed = by_address.map(|camera| SOCKET_FRAMES * camera.settings.frame_bytes()).max();
    let allowed = machine.value::<usize>(RMEM_MAX);
    let (Some(needed), Some(allowed)) = (needed, allowed) else { return Vec::new() };
    if needed <= allowed {
        return Vec::new();
    }
    vec![Finding::new(
        Severity::Warning,
        Check::SocketBuffer,
        format!(
            "sockets hold {allowed} bytes, {SOCKET_FRAMES} frames of a GigE Vision camera need {needed}: frames can be lost under load"
        ),
        format!(
            "echo net.core.rmem_max={needed} | sudo tee /etc/sysctl.d/70-uvcam.conf && sudo sysctl --system"
        ),
    )]
}
