//! The service that carries a camera's health.

use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe;

use super::Health;
use crate::error::{Fault, IpcError};
use crate::footing::Footing;
use crate::header::CONTRACT_VERSION;
use crate::premises;
use crate::quirks::Ipc;
use crate::service::{Address, Plan, Served, Visited, patiently};
use crate::settings::Settings;

type Service = publish_subscribe::PortFactory<Ipc, Health, ()>;
type Port = Subscriber<Ipc, Health, ()>;
type ReadersEnd = Visited<Port, Service>;

/// Readers at the same time.
const READERS: usize = 16;
/// Time between looks for a change.
const NAP: Duration = Duration::from_millis(10);
/// Silence after which a reader looks whether its driver is still there: a record comes every second.
const SILENCE: Duration = Duration::from_millis(1500);
/// Time between attempts to find the next one.
const RETRY: Duration = Duration::from_millis(50);
/// How long what may pass is tried again before it is reported: files that others just make or remove come and go.
const TOLERANCE: Duration = Duration::from_secs(3);

/// Name of the service that carries the health of `camera`.
pub fn health_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/health")
}

/// The driver's end.
#[derive(Debug)]
pub struct HealthPublisher(Served<Publisher<Ipc, Health, ()>, Service>);

/// The end of whoever wants to know. It finds the next driver when that comes, and the service that a driver has made anew.
#[derive(Debug)]
pub struct HealthReader {
    settings: Settings,
    camera: String,
    /// Missing while there is no driver.
    end: Option<ReadersEnd>,
    /// When to look next whether there is one: each record puts it off.
    next_look: Instant,
    failing_since: Option<Instant>,
    rejected: u64,
}

impl HealthPublisher {
    /// Makes the service of `camera`. To be called by the process that publishes its frames. A predecessor that is just stopping gets 3 s
    /// to go.
    ///
    /// # Errors
    /// [`IpcErrorKind::AlreadyPublishing`](crate::IpcErrorKind::AlreadyPublishing) where another driver tells of this camera, and those of
    /// [`Publisher::create`](crate::Publisher::create).
    pub fn create(settings: &Settings, camera: &str) -> Result<HealthPublisher, IpcError> {
        patiently(|| HealthPublisher::create_at_once(settings, camera))
    }

    /// The same, without waiting for a predecessor.
    ///
    /// # Errors
    /// As [`HealthPublisher::create`].
    pub fn create_at_once(settings: &Settings, camera: &str) -> Result<HealthPublisher, IpcError> {
        let plan = Plan {
            name: health_service_name(camera),
            pattern: MessagingPattern::PublishSubscribe,
            files: premises::FILES + READERS as u64,
            mapped_bytes: premises::MAPPED_BYTES,
        };
        let served = Served::create(settings, camera, plan, |address, node, name| {
            let created = builder(node, name)
                .max_publishers(1)
                .max_subscribers(READERS)
                .max_nodes(2 * READERS)
                .history_size(1)
                .subscriber_max_buffer_size(1)
                .subscriber_max_borrowed_samples(1)
                .enable_safe_overflow(true)
                .open_or_create();
            let service = address.created(name, created)?;
            let publisher =
                service.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData);
            let publisher = publisher.create().map_err(|source| match source {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    Fault::AlreadyPublishing(camera.to_owned()).into()
                }
                _ => address.failed("creating the publisher of", name.as_str(), source),
            })?;
            let number = publisher.id().value();
            Ok((service, publisher, number))
        })?;
        Ok(HealthPublisher(served))
    }

    /// The files that readers find this publisher by. Where one is no longer in place, this publisher is to be dropped, and another one
    /// made.
    pub fn footing(&self) -> &Footing {
        &self.0.footing
    }

    /// Puts a record in the place of the one before. Never waits.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails.
    pub fn publish(&self, health: &Health) -> Result<(), IpcError> {
        let Served { port, service, address, .. } = &self.0;
        let name = service.name();
        let record =
            port.loan_uninit().map_err(|source| address.failed("taking a slot of", name.as_str(), source))?;
        record
            .write_payload(*health)
            .send()
            .map_err(|source| address.failed("sending through", name.as_str(), source))?;
        Ok(())
    }

    /// Gives the newest record to readers that have come since. To be called a few times a second.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails.
    pub fn serve_newcomers(&self) -> Result<(), IpcError> {
        let Served { port, service, address, .. } = &self.0;
        port.update_connections()
            .map_err(|source| address.failed("connecting readers of", service.name().as_str(), source))
    }
}

impl HealthReader {
    /// Finds the driver of `camera`; `None` where none runs.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, files of another user, a driver of another version, or as many readers
    /// as there can be.
    pub fn open(settings: &Settings, camera: &str) -> Result<Option<HealthReader>, IpcError> {
        let end = Visited::open(settings, camera, &health_service_name(camera), subscribe)?;
        Ok(end.map(|end| HealthReader {
            settings: settings.clone(),
            camera: camera.to_owned(),
            end: Some(end),
            next_look: Instant::now() + SILENCE,
            failing_since: None,
            rejected: 0,
        }))
    }

    /// The newest record that has not been read, or `None` where there is none. Never waits.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails, and those of [`HealthReader::open`] where another driver
    /// has come.
    pub fn newest(&mut self) -> Result<Option<Health>, IpcError> {
        self.follow()?;
        while let Some(Visited { port, address, .. }) = &self.end {
            let record = port.receive().map_err(|source| {
                address.failed("receiving from", &health_service_name(&address.camera), source)
            })?;
            let Some(record) = record else { break };
            self.next_look = Instant::now() + SILENCE;
            let health = *record.payload();
            match health.validate() {
                Ok(()) => return Ok(Some(health)),
                Err(_) => self.rejected += 1,
            }
        }
        Ok(None)
    }

    /// After a silence: lets go of a service that has no driver behind it or that others do not find any more, and looks for another.
    fn follow(&mut self) -> Result<(), IpcError> {
        let now = Instant::now();
        if now < self.next_look {
            return Ok(());
        }
        self.next_look = now + RETRY;
        // What it has not read yet comes first.
        self.end = self.end.take().filter(|end| end.port.has_samples().unwrap_or(false) || end.is_served());
        if self.end.is_none() {
            let name = health_service_name(&self.camera);
            match Visited::open_at_once(&self.settings, &self.camera, &name, subscribe) {
                Ok(end) => (self.end, self.failing_since) = (end, None),
                Err(error)
                    if error.may_pass()
                        && now.duration_since(*self.failing_since.get_or_insert(now)) < TOLERANCE => {}
                Err(error) => return Err(error),
            }
        }
        if self.end.is_some() {
            self.next_look = now + SILENCE;
        }
        Ok(())
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

    /// Whether the service of a driver is open at this moment, be the driver alive or not.
    pub fn is_connected(&self) -> bool {
        self.end.is_some()
    }

    /// Records dropped because they were not to be trusted.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

impl ReadersEnd {
    /// Whether a driver, be it alive or not, publishes by this service, and others find it.
    fn is_served(&self) -> bool {
        self.service.get().is_some_and(|service| {
            service.dynamic_config().number_of_publishers() > 0
                && self.address.finds(service, MessagingPattern::PublishSubscribe)
        })
    }
}

/// Subscribes to a service that has a driver; `None` where there is none.
fn subscribe(
    address: &Address,
    node: &Node<Ipc>,
    name: &ServiceName,
) -> Result<Option<(Service, Port)>, IpcError> {
    let Some(service) = address.opened(name, builder(node, name).open())? else { return Ok(None) };
    if service.dynamic_config().number_of_publishers() == 0 {
        return Ok(None);
    }
    let subscriber = service.subscriber_builder().create().map_err(|source| match source {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
            Fault::TooManyConsumers(name.as_str().to_owned()).into()
        }
        _ => address.failed("subscribing to", name.as_str(), source),
    })?;
    Ok(Some((service, subscriber)))
}

fn builder(node: &Node<Ipc>, name: &ServiceName) -> Builder<Health, (), Ipc> {
    node.service_builder(name).publish_subscribe::<Health>()
}
