//! How each end of each service comes to be: signing in, cleaning up, trying again, holding what was opened.
//!
//! The driver's ends make their service ([`Served`]); the ends of others open it where it is there ([`Visited`]). Frames, which have two
//! services and a page, take the steps one by one.

use std::fmt;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::prelude::*;

use crate::cleanup::{cleanup, clear_the_way, half_made};
use crate::error::{Fault, IpcError};
use crate::footing::{Footing, Held, marks_of};
use crate::header::CONTRACT_VERSION;
use crate::log::quieten;
use crate::premises;
use crate::quirks::{self, Ipc, SHARED_MEMORY};
use crate::resident;
use crate::settings::{Settings, is_name};
use crate::wake_word;

mod refusal;

pub(crate) use refusal::Refusal;

use refusal::Reason;

/// How long the driver's ends wait for a predecessor to go and for others to let go of services that do not fit.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time between their attempts.
const RETRY: Duration = Duration::from_millis(20);

/// A camera, and what is needed to reach its services.
#[derive(Debug)]
pub(crate) struct Address {
    pub(crate) camera: String,
    pub(crate) config: Config,
}

impl Address {
    pub(crate) fn new(settings: &Settings, camera: &str) -> Result<Self, IpcError> {
        quieten();
        let config = settings.to_iceoryx2()?;
        if !is_name(camera, 64) {
            return Err(wrong_name(camera));
        }
        premises::check_owner(&config)?;
        Ok(Address { camera: camera.to_owned(), config })
    }

    /// As [`Address::new`], for the publisher of frames, which waits for nobody: iceoryx2 connects to new consumers while it sends a frame,
    /// and would wait there for memory that a consumer has not finished, or that belongs to another user. A consumer that was not
    /// connected to notices it, and comes again.
    ///
    /// Health and control wait a little instead: iceoryx2 connects once, their readers and clients would not notice, and nothing there is
    /// near the path of a frame.
    pub(crate) fn for_publisher(settings: &Settings, camera: &str) -> Result<Self, IpcError> {
        let mut address = Address::new(settings, camera)?;
        address.config.global.creation_timeout = Duration::ZERO;
        Ok(address)
    }

    /// The name of one of its services, as iceoryx2 wants it.
    pub(crate) fn service_name(&self, name: &str) -> Result<ServiceName, IpcError> {
        ServiceName::new(name).map_err(|_| wrong_name(&self.camera))
    }

    /// Signs this program in, where all is there that it relies on, and room to open as many files and to map as much.
    fn node(&self, files: u64, mapped_bytes: u64) -> Result<Node<Ipc>, IpcError> {
        premises::check(&self.config, files, mapped_bytes)?;
        let builder =
            NodeBuilder::new().config(&self.config).signal_handling_mode(SignalHandlingMode::Disabled);
        let node = builder.create().map_err(|source| match source {
            iceoryx2::node::NodeCreationFailure::InsufficientPermissions => premises::no_access(&self.config),
            _ => self.failed("signing in at", self.root_path(), source),
        });
        premises::close_management(&self.config);
        node
    }

    /// Signs a driver in, after a predecessor that was killed has given its place to it.
    pub(crate) fn driver_node(&self, files: u64, mapped_bytes: u64) -> Result<Node<Ipc>, IpcError> {
        if let Some(path) = half_made(&self.config) {
            let source = io::Error::from(io::ErrorKind::TimedOut);
            let on = path.display().to_string();
            return Err(self.failed("waiting for another program to finish", &on, source));
        }
        clear_the_way(&self.config);
        self.node(files, mapped_bytes)
    }

    /// Signs a consumer in; `None` where there is no `root_path`, so that no driver runs. Who only looks for one makes nothing.
    pub(crate) fn visiting_node(&self) -> Result<Option<Node<Ipc>>, IpcError> {
        if premises::has_root_path(&self.config) {
            return self.node(premises::FILES, premises::MAPPED_BYTES).map(Some);
        }
        premises::check_shared_memory()?;
        Ok(None)
    }

    /// To be asked where a service is not there: fails where the camera's driver runs and has another version of the contract. The names of
    /// services hold the version, that of the page does not.
    pub(crate) fn check_version(&self) -> Result<(), IpcError> {
        let page = wake_word::version_of(&self.wake_word());
        let Some(found) = page.filter(|found| *found != u32::from(CONTRACT_VERSION)) else { return Ok(()) };
        let name = self.service_name(&format!("uvcam/v{found}/{}/frames", self.camera))?;
        match Ipc::details(&name, &self.config, MessagingPattern::PublishSubscribe) {
            Ok(Some(details)) if details.dynamic_details.is_some() => {
                Err(Fault::OtherVersion { camera: self.camera.clone(), found }.into())
            }
            _ => Ok(()),
        }
    }

    /// A service that was to be opened; `None` where it is not there, half made or half removed.
    pub(crate) fn opened<S, R: Refusal>(
        &self,
        name: &ServiceName,
        outcome: Result<S, R>,
    ) -> Result<Option<S>, IpcError> {
        match outcome {
            Ok(service) => Ok(Some(service)),
            Err(refusal) if refusal.reason() == Reason::Absent => Ok(None),
            Err(refusal) => Err(self.refused("opening service", name, refusal)),
        }
    }

    /// A service that was to be made, or opened where others hold it from before.
    pub(crate) fn created<S, R: Refusal>(
        &self,
        name: &ServiceName,
        outcome: Result<S, R>,
    ) -> Result<S, IpcError> {
        outcome.map_err(|refusal| self.refused("creating service", name, refusal))
    }

    fn refused<R: Refusal>(&self, doing: &'static str, name: &ServiceName, refusal: R) -> IpcError {
        let service = name.as_str().to_owned();
        match refusal.reason() {
            Reason::Permission => premises::no_access(&self.config),
            Reason::Full => Fault::TooManyConsumers(service).into(),
            Reason::Incompatible => Fault::Incompatible { service, source: Box::new(refusal) }.into(),
            Reason::Absent | Reason::Other => self.failed(doing, &service, refusal),
        }
    }

    /// Whether who comes now finds this service, and no other one under its name.
    pub(crate) fn finds<S: PortFactory>(&self, service: &S, pattern: MessagingPattern) -> bool {
        let details = Ipc::details(service.name(), &self.config, pattern);
        matches!(details, Ok(Some(found)) if found.dynamic_details.is_some()
            && found.static_details.unique_service_id() == service.unique_service_id())
    }

    /// The driver's side: removes the description of a service whose register is gone, which can be neither opened nor made anew.
    pub(crate) fn clear_description(&self, service: &ServiceName, pattern: MessagingPattern) {
        if let Ok(Some(found)) = Ipc::details(service, &self.config, pattern)
            && found.dynamic_details.is_none()
        {
            let description = quirks::description(&self.config, found.static_details.service_hash());
            // What cannot be removed fails when the service is made.
            let _ = std::fs::remove_file(description);
        }
    }

    /// Takes the memory of all small files that were just made or opened, so that nobody meets their absence later.
    pub(crate) fn take_small_files(&self) -> Result<(), IpcError> {
        resident::make_small_files_present(self.config.global.prefix.as_str()).map_err(|source| {
            let full = premises::check_room(0).err();
            full.unwrap_or_else(|| self.failed("taking the memory of files in", SHARED_MEMORY, source))
        })
    }

    pub(crate) fn failed(
        &self,
        doing: &'static str,
        on: &str,
        source: impl std::error::Error + Send + Sync + 'static,
    ) -> IpcError {
        Fault::System { doing, on: on.to_owned(), source: Box::new(source) }.into()
    }

    /// The page of the camera's wake word. `root_path`, which is there when it is needed, may have several paths, in containers and by links.
    pub(crate) fn wake_word(&self) -> PathBuf {
        let (device, inode) =
            std::fs::metadata(self.root_path()).map_or((0, 0), |found| (found.dev(), found.ino()));
        let prefix = self.config.global.prefix;
        Path::new(SHARED_MEMORY).join(format!("{prefix}{}.{device:x}-{inode:x}.wake", self.camera))
    }

    fn root_path(&self) -> &str {
        self.config.global.root_path().as_str()
    }
}

fn wrong_name(camera: &str) -> IpcError {
    Fault::CameraName(camera.to_owned()).into()
}

/// Tries again for a while what may succeed when a predecessor has stopped, others have let go, and half-made files are gone.
pub(crate) fn patiently<T>(mut attempt: impl FnMut() -> Result<T, IpcError>) -> Result<T, IpcError> {
    let give_up = Instant::now() + PATIENCE;
    loop {
        match attempt() {
            Err(error) if error.ends_with_others() && Instant::now() < give_up => std::thread::sleep(RETRY),
            outcome => return outcome,
        }
    }
}

/// What the driver's end of a service is called and takes.
pub(crate) struct Plan {
    pub(crate) name: String,
    pub(crate) pattern: MessagingPattern,
    /// Files that it has open once all are connected that there can be.
    pub(crate) files: u64,
    pub(crate) mapped_bytes: u64,
}

/// The driver's end of a service, which it makes.
pub(crate) struct Served<P, S> {
    // In this order: a service and its node live as long as their ports.
    pub(crate) port: P,
    pub(crate) service: S,
    _node: Node<Ipc>,
    pub(crate) address: Address,
    pub(crate) footing: Footing,
}

impl<P, S: PortFactory> Served<P, S> {
    /// Makes the service of `camera`, and its port, whose number in the names of files comes with it.
    pub(crate) fn create(
        settings: &Settings,
        camera: &str,
        plan: Plan,
        make: impl FnOnce(&Address, &Node<Ipc>, &ServiceName) -> Result<(S, P, u128), IpcError>,
    ) -> Result<Self, IpcError> {
        let address = Address::new(settings, camera)?;
        let name = address.service_name(&plan.name)?;
        let node = address.driver_node(plan.files, plan.mapped_bytes)?;
        address.clear_description(&name, plan.pattern);
        let (service, port, number) = make(&address, &node, &name)?;
        let mut marks = marks_of(&service).to_vec();
        marks.extend([number, node.id().value()].map(|number| number.to_string()));
        let footing = Footing::of(&address.config, &marks);
        address.take_small_files()?;
        Ok(Served { port, service, _node: node, address, footing })
    }
}

/// Another program's end of a service, which it finds.
pub(crate) struct Visited<P, S: PortFactory> {
    // In this order: as above.
    pub(crate) port: P,
    pub(crate) service: Held<S>,
    _node: Node<Ipc>,
    pub(crate) address: Address,
}

impl<P, S: PortFactory> Visited<P, S> {
    /// Opens the service of `camera`, and makes its port; `None` where no driver runs.
    pub(crate) fn open(
        settings: &Settings,
        camera: &str,
        name: &str,
        open: impl FnOnce(&Address, &Node<Ipc>, &ServiceName) -> Result<Option<(S, P)>, IpcError>,
    ) -> Result<Option<Self>, IpcError> {
        let address = Address::new(settings, camera)?;
        // What others are just making is soon finished, or never.
        let give_up = Instant::now() + PATIENCE;
        while half_made(&address.config).is_some() && Instant::now() < give_up {
            std::thread::sleep(RETRY);
        }
        // A driver that was killed must not be taken for one that runs.
        cleanup(&address.config);
        Visited::find(address, name, open)
    }

    /// The same, without waiting for what others are making, and without a look at who was killed.
    pub(crate) fn open_at_once(
        settings: &Settings,
        camera: &str,
        name: &str,
        open: impl FnOnce(&Address, &Node<Ipc>, &ServiceName) -> Result<Option<(S, P)>, IpcError>,
    ) -> Result<Option<Self>, IpcError> {
        Visited::find(Address::new(settings, camera)?, name, open)
    }

    fn find(
        address: Address,
        name: &str,
        open: impl FnOnce(&Address, &Node<Ipc>, &ServiceName) -> Result<Option<(S, P)>, IpcError>,
    ) -> Result<Option<Self>, IpcError> {
        let name = address.service_name(name)?;
        let Some(node) = address.visiting_node()? else { return Ok(None) };
        let Some((service, port)) = open(&address, &node, &name)? else {
            return address.check_version().map(|()| None);
        };
        address.take_small_files()?;
        Ok(Some(Visited { port, service: Held::new(service, &address.config), _node: node, address }))
    }
}

impl<P, S> fmt::Debug for Served<P, S> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Served").field("camera", &self.address.camera).finish_non_exhaustive()
    }
}

impl<P, S: PortFactory> fmt::Debug for Visited<P, S> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Visited").field("camera", &self.address.camera).finish_non_exhaustive()
    }
}
