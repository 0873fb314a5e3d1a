//! The two services that carry a camera's frames and wake consumers with a `WaitSet`.

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::cleanup::half_made;
use crate::error::IpcError;
use crate::header::{CONTRACT_VERSION, FrameHeader};
use crate::quirks::Ipc;
use crate::service::Address;
use crate::settings::Settings;

pub(crate) type FrameService = publish_subscribe::PortFactory<Ipc, [u8], FrameHeader>;
pub(crate) type WakeService = event::PortFactory<Ipc>;

/// Name of the service that carries the frames of `camera`.
pub fn frame_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/frames")
}

/// Name of the event service of `camera`, for consumers that attach it to a `WaitSet`: notified after every frame.
pub fn wake_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/wake")
}

/// The driver's side: makes the services, or opens them where consumers hold them from before.
pub(crate) fn create(
    address: &Address,
    node: &Node<Ipc>,
    settings: &Settings,
) -> Result<(FrameService, WakeService), IpcError> {
    let [frames, wake] = names(address)?;
    address.clear_description(&frames, MessagingPattern::PublishSubscribe);
    address.clear_description(&wake, MessagingPattern::Event);
    // Room for killed programs that nobody cleaned up yet.
    let max_nodes = 2 * settings.max_subscribers + 2;
    let created = node
        .service_builder(&frames)
        .publish_subscribe::<[u8]>()
        .user_header::<FrameHeader>()
        .max_publishers(1)
        .max_subscribers(settings.max_subscribers)
        .max_nodes(max_nodes)
        .subscriber_max_buffer_size(settings.buffer)
        .subscriber_max_borrowed_samples(settings.borrowed)
        .history_size(0)
        .enable_safe_overflow(true)
        .open_or_create();
    let frames = address.created(&frames, created)?;
    let created = node
        .service_builder(&wake)
        .event()
        .max_notifiers(1)
        .max_listeners(settings.max_subscribers)
        .max_nodes(max_nodes)
        .event_id_max_value(0)
        .open_or_create();
    Ok((frames, address.created(&wake, created)?))
}

/// The consumer's side: opens the services, whatever the numbers they were made with; `None` where they are not there, half made or half
/// removed.
pub(crate) fn open(
    address: &Address,
    node: &Node<Ipc>,
) -> Result<Option<(FrameService, WakeService)>, IpcError> {
    if half_made(&address.config).is_some() {
        return Ok(None);
    }
    let [frames, wake] = names(address)?;
    let builder = node.service_builder(&frames).publish_subscribe::<[u8]>().user_header::<FrameHeader>();
    let Some(frames) = address.opened(&frames, builder.open())? else { return Ok(None) };
    let opened = node.service_builder(&wake).event().open();
    Ok(address.opened(&wake, opened)?.map(|wake| (frames, wake)))
}

fn names(address: &Address) -> Result<[ServiceName; 2], IpcError> {
    Ok([
        address.service_name(&frame_service_name(&address.camera))?,
        address.service_name(&wake_service_name(&address.camera))?,
    ])
}
