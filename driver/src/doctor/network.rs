//! What GigE Vision cameras need of the network.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};

use super::machine::Machine;
use super::{Finding, Severity};
use crate::camera::SOCKET_FRAMES;
use crate::config::{Config, Source};

/// The kernel's limit on the buffer of a socket.
const RMEM_MAX: &str = "/proc/sys/net/core/rmem_max";
/// The kernel's routes.
const ROUTES: &str = "/proc/net/route";
/// The rules of the firewall that are loaded at start.
const FIREWALL: &str = "/etc/nftables.conf";
/// More of them, where the first file includes them.
const MORE_FIREWALL: &str = "/etc/nftables.d";

/// Networks of GigE Vision cameras.
pub(super) fn examine(machine: &Machine, config: &Config) -> Vec<Finding> {
    [socket_buffer(machine, config), firewall(machine, config)].concat()
}

/// Whether a socket holds enough frames of each camera that is configured by its IP address; of others it is not known whether
/// they speak GigE Vision.
fn socket_buffer(machine: &Machine, config: &Config) -> Vec<Finding> {
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
        "socket_buffer",
        format!(
            "sockets hold {allowed} bytes, {SOCKET_FRAMES} frames of a GigE Vision camera need {needed}: frames can be lost under load"
        ),
        format!(
            "echo net.core.rmem_max={needed} | sudo tee /etc/sysctl.d/70-uvcam.conf && sudo sysctl --system"
        ),
    )]
}

/// Whether a rule of the firewall names each camera that is configured by its IP address. No file tells which rules are in force.
fn firewall(machine: &Machine, config: &Config) -> Vec<Finding> {
    let more = machine.names(MORE_FIREWALL).into_iter().map(|name| format!("{MORE_FIREWALL}/{name}"));
    let files = std::iter::once(FIREWALL.to_owned()).chain(more);
    let rules: String = files.filter_map(|file| Some(machine.text(&file)? + "\n")).collect();
    let is_named = |address: &Ipv4Addr| {
        let mut words = rules.split(|character: char| !character.is_ascii_digit() && character != '.');
        words.any(|word| word == address.to_string())
    };
    let mut unnamed: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for camera in &config.cameras {
        let Source::Aravis { serial } = &camera.source else { continue };
        let Some(address) = serial.parse().ok().filter(|address| !is_named(address)) else { continue };
        unnamed.entry(interface(machine, address)).or_default().push(address.to_string());
    }
    let finding = |(interface, addresses): (String, Vec<String>)| {
        let addresses = addresses.join(", ");
        Finding::new(
            Severity::Unknown,
            "firewall",
            format!(
                "whether a firewall lets only cameras ({addresses}) send UDP to this computer through {interface} was not examined: \
                 {FIREWALL} does not name them. The library trusts every packet: a forged one can end the driver, with all of its cameras"
            ),
            format!(
                "echo 'table inet uvcam {{ chain input {{ type filter hook input priority 0; iifname \"{interface}\" meta l4proto udp \
                 ip saddr != {{ {addresses} }} drop; }}; }}' | sudo tee --append {FIREWALL} && sudo systemctl enable --now nftables \
                 && sudo nft --file {FIREWALL}"
            ),
        )
    };
    unnamed.into_iter().map(finding).collect()
}

/// The interface through which this address is reached, by the most specific route.
fn interface(machine: &Machine, address: Ipv4Addr) -> String {
    let text = machine.text(ROUTES).unwrap_or_default();
    let routes = text.lines().skip(1).filter_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        // Numbers in the order of memory (kernel: fib_trie.c).
        let word = |place: usize| u32::from_str_radix(fields.get(place)?, 16).ok().map(u32::to_ne_bytes);
        let (network, mask) = (u32::from_be_bytes(word(1)?), u32::from_be_bytes(word(7)?));
        (u32::from(address) & mask == network).then_some((mask, *fields.first()?))
    });
    routes.max().map_or("the camera's interface", |(_, interface)| interface).to_owned()
}
