//! The driver's end of the service that carries a camera's mask.

use std::mem::size_of;

use iceoryx2::node::Node;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe;

use super::{
    DISCARD, KEEP, LONGEST_PROVENANCE, MAGIC, MaskHeader, RUN_BYTES, Run, are_sound, is_size, masked_px,
};
use crate::cleanup::forget_segments;
use crate::error::{Fault, IpcError, SettingError};
use crate::footing::Footing;
use crate::header::CONTRACT_VERSION;
use crate::premises;
use crate::quirks::Ipc;
use crate::service::{Plan, Served};
use crate::settings::{Settings, slots_needed};

pub(super) type Service = publish_subscribe::PortFactory<Ipc, [u8], MaskHeader>;

/// Masks that wait for a consumer that does not look.
const BUFFER: usize = 4;
/// Masks that a consumer may hold, those that its subscriber keeps included.
const BORROWED: usize = 8;
/// Masks in the driver's hands, the one for newcomers included.
const LOANS: usize = 2;
/// Runs that there is always room for. Masks in use have 150 to 1000.
const ROOM_RUNS: usize = 4096;

/// Name of the service that carries the mask of `camera`.
pub fn mask_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/mask")
}

/// A mask as a driver gives it out.
#[derive(Debug, Clone, Copy)]
pub struct NewMask<'a> {
    /// What the frames name it by.
    pub mask_id: [u8; 16],
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The masked runs in row order, from left to right, none touching another.
    pub runs: &'a [Run],
    /// Where it comes from, a JSON object of texts of at most [`LONGEST_PROVENANCE`] bytes.
    pub provenance: &'a str,
}

/// The driver's end.
#[derive(Debug)]
pub struct MaskPublisher {
    served: Served<Publisher<Ipc, [u8], MaskHeader>, Service>,
    capacity: usize,
}

impl MaskPublisher {
    /// Makes the service of `camera`, for `first` and masks of its size. To be called by the process that publishes its frames. Waits for
    /// no predecessor.
    ///
    /// # Errors
    /// [`IpcErrorKind::AlreadyPublishing`](crate::IpcErrorKind::AlreadyPublishing) where another driver gives out masks of this camera, and
    /// those of [`Publisher::create`](crate::Publisher::create).
    pub fn create(settings: &Settings, camera: &str, first: &NewMask<'_>) -> Result<MaskPublisher, IpcError> {
        let capacity = first.capacity()?;
        let slots = slots_needed(settings.max_subscribers, BUFFER, BORROWED, LOANS);
        let plan = Plan {
            name: mask_service_name(camera),
            pattern: MessagingPattern::PublishSubscribe,
            files: premises::FILES + settings.max_subscribers as u64,
            mapped_bytes: premises::MAPPED_BYTES.saturating_add(slots.saturating_mul(capacity) as u64),
        };
        let served = Served::create(settings, camera, plan, |address, node, name| {
            let created = builder(node, name)
                .max_publishers(1)
                .max_subscribers(settings.max_subscribers)
                .max_nodes(2 * settings.max_subscribers + 2)
                .history_size(1)
                .subscriber_max_buffer_size(BUFFER)
                .subscriber_max_borrowed_samples(BORROWED)
                .enable_safe_overflow(true)
                .open_or_create();
            let service = address.created(name, created)?;
            if service.dynamic_config().number_of_publishers() > 0 {
                return Err(Fault::AlreadyPublishing(camera.to_owned()).into());
            }
            let publisher = service
                .publisher_builder()
                .initial_max_slice_len(capacity)
                .max_loaned_samples(LOANS)
                .allocation_strategy(AllocationStrategy::Static)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
                .map_err(|source| {
                    forget_segments(&address.config, node.id().value());
                    match source {
                        PublisherCreateError::ExceedsMaxSupportedPublishers => {
                            Fault::AlreadyPublishing(camera.to_owned()).into()
                        }
                        _ => address.failed("creating the publisher of", name.as_str(), source),
                    }
                })?;
            let number = publisher.id().value();
            Ok((service, publisher, number))
        })?;
        Ok(MaskPublisher { served, capacity })
    }

    /// Whether there is room for this mask. Where there is none, this publisher is to be dropped, and another one made.
    pub fn has_room_for(&self, mask: &NewMask<'_>) -> bool {
        mask.header().payload_bytes() <= self.capacity
    }

    /// The files that consumers find this publisher by. Where one is no longer in place, this publisher is to be dropped, and another one
    /// made.
    pub fn footing(&self) -> &Footing {
        &self.served.footing
    }

    /// Gives out a mask, to be called before a frame names it. For a thread that has time: it writes the whole image.
    ///
    /// # Errors
    /// [`IpcErrorKind::Setting`](crate::IpcErrorKind::Setting) where the mask is none, [`IpcErrorKind::NoRoom`](crate::IpcErrorKind::NoRoom)
    /// where `/dev/shm` is full, [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails.
    pub fn publish(&self, mask: &NewMask<'_>) -> Result<(), IpcError> {
        mask.check()?;
        let Served { port, service, address, .. } = &self.served;
        let name = service.name();
        let header = mask.header();
        let bytes = header.payload_bytes();
        // Memory of masks is taken when it is first written.
        premises::check_room(bytes as u64)?;
        let mut sample = port
            .loan_slice(bytes)
            .map_err(|source| address.failed("taking a slot of", name.as_str(), source))?;
        *sample.user_header_mut() = header;
        mask.write(&header, sample.payload_mut());
        sample.send().map_err(|source| address.failed("sending through", name.as_str(), source))?;
        Ok(())
    }

    /// Gives the newest mask to consumers that have come since. To be called a few times a second.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails.
    pub fn serve_newcomers(&self) -> Result<(), IpcError> {
        let Served { port, service, address, .. } = &self.served;
        port.update_connections()
            .map_err(|source| address.failed("connecting consumers of", service.name().as_str(), source))
    }
}

impl NewMask<'_> {
    pub(super) fn header(&self) -> MaskHeader {
        MaskHeader {
            magic: MAGIC,
            contract_version: CONTRACT_VERSION,
            header_size: size_of::<MaskHeader>() as u16,
            width: self.width,
            height: self.height,
            mask_id: self.mask_id,
            masked_px: masked_px(self.runs),
            runs: self.runs.len().try_into().unwrap_or(u32::MAX),
            provenance_bytes: self.provenance.len().try_into().unwrap_or(u32::MAX),
            reserved: [0; 2],
        }
    }

    /// Bytes of a slot for this mask and others of its size.
    fn capacity(&self) -> Result<usize, IpcError> {
        self.check()?;
        let header = self.header();
        let runs = self.runs.len().max(ROOM_RUNS);
        Ok(header.runs_at() + runs * RUN_BYTES + LONGEST_PROVENANCE)
    }

    fn check(&self) -> Result<(), SettingError> {
        let Self { width, height, runs, provenance, .. } = *self;
        if !is_size(width, height) {
            return Err(SettingError::new("mask", format!("{width}x{height}"), "1 to 65535 pixels a side"));
        }
        if !are_sound(runs, width, height) {
            return Err(SettingError::new(
                "mask",
                format!("{} runs", runs.len()),
                "runs inside the image, in their order",
            ));
        }
        if provenance.len() > LONGEST_PROVENANCE {
            let found = format!("{} bytes", provenance.len());
            return Err(SettingError::new("provenance", found, "at most 16384 bytes"));
        }
        Ok(())
    }

    pub(super) fn write(&self, header: &MaskHeader, payload: &mut [u8]) {
        payload.fill(0);
        let width = header.width as usize;
        if let Some(image) = payload.get_mut(..header.image_bytes()) {
            image.fill(KEEP);
            for run in self.runs {
                let start = run.row as usize * width + run.start as usize;
                image.iter_mut().skip(start).take(run.length as usize).for_each(|pixel| *pixel = DISCARD);
            }
        }
        let numbers = self.runs.iter().flat_map(|run| [run.row, run.start, run.length]);
        let bytes = numbers.flat_map(u32::to_le_bytes).chain(self.provenance.bytes());
        payload.iter_mut().skip(header.runs_at()).zip(bytes).for_each(|(to, byte)| *to = byte);
    }
}

pub(super) fn builder(node: &Node<Ipc>, name: &ServiceName) -> Builder<[u8], MaskHeader, Ipc> {
    node.service_builder(name).publish_subscribe::<[u8]>().user_header::<MaskHeader>()
}
