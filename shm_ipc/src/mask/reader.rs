//! A consumer's end: the masks that its frames name.

use std::collections::VecDeque;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::PortFactory;

use super::publisher::{Service, builder, mask_service_name};
use super::{Mask, MaskHeader};
use crate::cleanup::half_made;
use crate::clock::{after, monotonic_ns};
use crate::error::{Fault, IpcError};
use crate::footing::Held;
use crate::header::FrameHeader;
use crate::quirks::Ipc;
use crate::service::Address;

/// Masks that are kept for frames to come: a consumer's frames may lag behind what has come of the masks.
const KEPT: usize = 4;
/// Time between attempts to find the service.
const RETRY: Duration = Duration::from_millis(50);
/// How long a service that does not bring the mask of a frame is believed to be the driver's. One that was made anew is found then.
const BELIEF: Duration = Duration::from_secs(1);

/// The masks of one camera. Opened when the first one is asked for.
#[derive(Debug, Default)]
pub(crate) struct MaskReader {
    link: Option<Link>,
    kept: VecDeque<Mask>,
    /// When to try next to open it, CLOCK_MONOTONIC in ns.
    next_try_ns: u64,
    /// Since when it has not brought what was asked for, CLOCK_MONOTONIC in ns.
    missing_since_ns: Option<u64>,
}

#[derive(Debug)]
struct Link {
    // In this order: a port is dropped before its service.
    subscriber: Subscriber<Ipc, [u8], MaskHeader>,
    _service: Held<Service>,
}

impl MaskReader {
    /// The mask that a frame names. Never waits.
    pub(crate) fn mask_of(
        &mut self,
        frame: &FrameHeader,
        address: &Address,
        node: Option<&Node<Ipc>>,
    ) -> Result<Mask, IpcError> {
        if let Some(mask) = self.find(frame) {
            return Ok(mask);
        }
        let now_ns = monotonic_ns();
        if now_ns >= after(BELIEF, *self.missing_since_ns.get_or_insert(now_ns)) {
            self.let_go();
            self.missing_since_ns = Some(now_ns);
        }
        if let (None, Some(node)) = (&self.link, node)
            && now_ns >= self.next_try_ns
        {
            self.next_try_ns = after(RETRY, now_ns);
            self.link = Link::open(address, node)?;
        }
        self.receive(address)?;
        let pending = || Fault::MaskPending { camera: address.camera.clone(), mask_id: frame.mask_id };
        let mask = self.find(frame).ok_or_else(pending)?;
        self.missing_since_ns = None;
        Ok(mask)
    }

    /// Lets go of the driver's service; masks that came stay.
    pub(crate) fn let_go(&mut self) {
        self.link = None;
    }

    fn find(&self, frame: &FrameHeader) -> Option<Mask> {
        self.kept.iter().rev().find(|mask| mask.is_of(frame)).cloned()
    }

    /// Takes what has come; where more has come than is kept, the newest.
    fn receive(&mut self, address: &Address) -> Result<(), IpcError> {
        while let Some(link) = &self.link {
            match link.subscriber.receive() {
                Ok(None) => break,
                Ok(Some(sample)) => {
                    // One that is not to be trusted is none.
                    self.kept.extend(Mask::received(sample));
                    if self.kept.len() > KEPT {
                        self.kept.pop_front();
                    }
                }
                Err(ReceiveError::ExceedsMaxBorrows) => {
                    return Err(Fault::TooManyMasks(address.camera.clone()).into());
                }
                Err(ReceiveError::ConnectionFailure(_)) => self.link = None,
            }
        }
        Ok(())
    }
}

impl Link {
    /// Opens the service; `None` where it is not there, half made or half removed.
    fn open(address: &Address, node: &Node<Ipc>) -> Result<Option<Link>, IpcError> {
        if half_made(&address.config).is_some() {
            return Ok(None);
        }
        let name = address.service_name(&mask_service_name(&address.camera))?;
        let Some(service) = address.opened(&name, builder(node, &name).open())? else { return Ok(None) };
        let subscriber = service.subscriber_builder().create().map_err(|source| match source {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                Fault::TooManyConsumers(service.name().as_str().to_owned()).into()
            }
            _ => address.failed("subscribing to", service.name().as_str(), source),
        })?;
        address.take_small_files()?;
        let service = Held::new(service, &address.config);
        Ok(Some(Link { subscriber, _service: service }))
    }
}
