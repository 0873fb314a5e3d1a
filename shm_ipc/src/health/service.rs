//! The service that carries a camera's health.

use std::fmt;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeOpenError as OpenError};
use iceoryx2::service::port_factory::publish_subscribe;

use super::Health;
use crate::cleanup::{cleanup, clear_the_way};
use crate::error::IpcError;
use crate::footing::{Footing, Held};
use crate::header::CONTRACT_VERSION;
use crate::premises;
use crate::service::{Address, Ipc};
use crate::settings::Settings;

type Service = publish_subscribe::PortFactory<Ipc, Health, ()>;

/// Readers at the same time.
const READERS: usize = 16;
/// How long [`HealthPublisher::create`] waits for a predecessor to go.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time between looks for a change.
const NAP: Duration = Duration::from_millis(10);

/// Name of the service that carries the health of `camera`.
pub fn health_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/health")
}

/// The driver's end.
pub struct HealthPublisher {
    publisher: Publisher<Ipc, Health, ()>,
    // A service and its node live as long as their ports.
    service: Service,
    _node: Node<Ipc>,
    address: Address,
    footing: Footing,
}

/// The end of whoever wants to know.
pub struct HealthReader {
    subscriber: Subscriber<Ipc, Health, ()>,
    _service: Held<Service>,
    _node: Node<Ipc>,
    address: Address,
    rejected: u64,
}

impl HealthPublisher {
    /// Makes the service of `camera`. To be called by the process that publishes its frames.
    ///
    /// # Errors
    /// [`IpcError::AlreadyPublishing`] where another driver tells of this camera, and those of
    /// [`Publisher::create`](crate::Publisher::create).
    pub fn create(settings: &Settings, camera: &str) -> Result<HealthPublisher, IpcError> {
        let give_up = Instant::now() + PATIENCE;
        loop {
            match HealthPublisher::create_at_once(settings, camera) {
                Err(IpcError::AlreadyPublishing(_) | IpcError::System { .. }) if Instant::now() < give_up => {
                    std::thread::sleep(NAP);
                }
                outcome => return outcome,
            }
        }
    }

    /// The same, without waiting for a predecessor.
    ///
    /// # Errors
    /// As [`HealthPublisher::create`].
    pub fn create_at_once(settings: &Settings, camera: &str) -> Result<HealthPublisher, IpcError> {
        let (address, name) = address(settings, camera)?;
        // A predecessor that was killed gives its place to this one.
        clear_the_way(&address.config);
        let node = address.node_with_room_for(premises::FILES + READERS as u64, premises::MAPPED_BYTES)?;
        address.clear_description(&name, MessagingPattern::PublishSubscribe);
        let service = builder(&node, &name)
            .max_publishers(1)
            .max_subscribers(READERS)
            .max_nodes(2 * READERS)
            .history_size(1)
            .subscriber_max_buffer_size(1)
            .subscriber_max_borrowed_samples(1)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|source| address.failed("creating service", name.as_str(), source))?;
        let publisher = service
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|source| match source {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    IpcError::AlreadyPublishing(camera.to_owned())
                }
                _ => address.failed("creating the publisher of", name.as_str(), source),
            })?;
        let marks = [
            service.unique_service_id().value().to_string(),
            service.service_hash().to_string(),
            publisher.id().value().to_string(),
            node.id().value().to_string(),
        ];
        let footing = address.footing(&marks);
        address.take_small_files()?;
        Ok(HealthPublisher { publisher, service, _node: node, address, footing })
    }

    /// The files that readers find this publisher by. Where one is no longer in place, this publisher is to be dropped, and another one
    /// made.
    pub fn footing(&self) -> &Footing {
        &self.footing
    }

    /// Puts a record in the place of the one before. Never waits.
    ///
    /// # Errors
    /// [`IpcError::System`] where iceoryx2 fails.
    pub fn publish(&self, health: &Health) -> Result<(), IpcError> {
        let name = self.service.name();
        let record = self
            .publisher
            .loan_uninit()
            .map_err(|source| self.address.failed("taking a slot of", name.as_str(), source))?;
        record
            .write_payload(*health)
            .send()
            .map_err(|source| self.address.failed("sending through", name.as_str(), source))?;
        Ok(())
    }

    /// Gives the newest record to readers that have come since. To be called a few times a second.
    ///
    /// # Errors
    /// [`IpcError::System`] where iceoryx2 fails.
    pub fn serve_newcomers(&self) -> Result<(), IpcError> {
        let name = self.service.name();
        self.publisher
            .update_connections()
            .map_err(|source| self.address.failed("connecting readers of", name.as_str(), source))
    }
}

impl HealthReader {
    /// Finds the driver of `camera`; `None` where none runs.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, files of another user, a driver of another version, or as many readers
    /// as there can be.
    pub fn open(settings: &Settings, camera: &str) -> Result<Option<HealthReader>, IpcError> {
        let (address, name) = address(settings, camera)?;
        // A driver that was killed must not be taken for one that runs.
        cleanup(&address.config);
        let Some(node) = address.visiting_node()? else { return Ok(None) };
        let service = match builder(&node, &name).open() {
            Ok(service) => service,
            Err(
                OpenError::DoesNotExist
                | OpenError::ServiceInCorruptedState
                | OpenError::IsMarkedForDestruction
                | OpenError::HangsInCreation,
            ) => return Ok(None),
            Err(source) => return Err(address.failed("opening service", name.as_str(), source)),
        };
        if service.dynamic_config().number_of_publishers() == 0 {
            return Ok(None);
        }
        let subscriber = service
            .subscriber_builder()
            .create()
            .map_err(|source| address.failed("subscribing to", name.as_str(), source))?;
        address.take_small_files()?;
        let service = Held::new(service, &address.config);
        Ok(Some(HealthReader { subscriber, _service: service, _node: node, address, rejected: 0 }))
    }

    /// The newest record that has not been read, or `None` where there is none. Never waits.
    ///
    /// # Errors
    /// [`IpcError::System`] where iceoryx2 fails.
    pub fn newest(&mut self) -> Result<Option<Health>, IpcError> {
        loop {
            let received = self.subscriber.receive();
            let record = received.map_err(|source| {
                let name = health_service_name(&self.address.camera);
                self.address.failed("receiving from", &name, source)
            })?;
            let Some(record) = record else { return Ok(None) };
            let health = *record.payload();
            match health.validate() {
                Ok(()) => return Ok(Some(health)),
                Err(_) => self.rejected += 1,
            }
        }
    }

    /// Waits at most `timeout` for a record. `None` where none came, because the driver is gone or stuck.
    ///
    /// # Errors
    /// As [`HealthReader::newest`].
    pub fn wait(&mut self, timeout: Duration) -> Result<Option<Health>, IpcError> {
        let begin = Instant::now();
        loop {
            match self.newest()? {
                None if begin.elapsed() < timeout => std::thread::sleep(NAP.min(timeout)),
                outcome => return Ok(outcome),
            }
        }
    }

    /// Records dropped because they were not to be trusted.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

fn address(settings: &Settings, camera: &str) -> Result<(Address, ServiceName), IpcError> {
    let address = Address::new(settings, camera)?;
    let name = ServiceName::new(&health_service_name(camera));
    Ok((address, name.map_err(|_| IpcError::CameraName(camera.to_owned()))?))
}

fn builder(node: &Node<Ipc>, name: &ServiceName) -> Builder<Health, (), Ipc> {
    node.service_builder(name).publish_subscribe::<Health>()
}

impl fmt::Debug for HealthPublisher {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("HealthPublisher")
            .field("camera", &self.address.camera)
            .finish_non_exhaustive()
    }
}

impl fmt::Debug for HealthReader {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("HealthReader").field("camera", &self.address.camera).finish_non_exhaustive()
    }
}
