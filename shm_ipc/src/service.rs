//! The two services of a camera: their names, how they are made, found and cleaned up.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::event::{EventOpenError as OpenWake, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError as CreateFrames, PublishSubscribeOpenError as OpenFrames,
    PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::cleanup::half_made;
use crate::error::IpcError;
use crate::footing::Footing;
use crate::header::{CONTRACT_VERSION, FrameHeader};
use crate::log::quieten;
use crate::premises;
use crate::resident;
use crate::settings::{SHARED_MEMORY, Settings, is_name};

/// Ports behind a mutex, so that slots and frames may go from thread to thread; 0.2 us a call over `ipc` where the cache is warm.
pub(crate) type Ipc = ipc_threadsafe::Service;
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

/// The names of a camera's services, and what is needed to reach them.
#[derive(Debug)]
pub(crate) struct Address {
    pub(crate) camera: String,
    pub(crate) config: Config,
    frames: ServiceName,
    wake: ServiceName,
}

impl Address {
    pub(crate) fn new(settings: &Settings, camera: &str) -> Result<Self, IpcError> {
        quieten();
        let config = settings.to_iceoryx2()?;
        let wrong = || IpcError::CameraName(camera.to_owned());
        if !is_name(camera, 64) {
            return Err(wrong());
        }
        let frames = ServiceName::new(&frame_service_name(camera)).map_err(|_| wrong())?;
        let wake = ServiceName::new(&wake_service_name(camera)).map_err(|_| wrong())?;
        premises::check_owner(&config)?;
        Ok(Address { camera: camera.to_owned(), config, frames, wake })
    }

    /// As [`Address::new`], for the driver, which waits for nobody: iceoryx2 connects to new consumers while it sends a frame, and would
    /// wait there for memory that a consumer has not finished, or that belongs to another user. What can be tried again is.
    pub(crate) fn for_driver(settings: &Settings, camera: &str) -> Result<Self, IpcError> {
        let mut address = Address::new(settings, camera)?;
        address.config.global.creation_timeout = Duration::ZERO;
        Ok(address)
    }

    /// Signs this program in, where all is there that it relies on.
    pub(crate) fn node(&self) -> Result<Node<Ipc>, IpcError> {
        self.node_with_room_for(premises::FILES, premises::MAPPED_BYTES)
    }

    /// The same for a program that is about to open as many files and to map as much.
    pub(crate) fn node_with_room_for(&self, files: u64, mapped_bytes: u64) -> Result<Node<Ipc>, IpcError> {
        premises::check(&self.config, files, mapped_bytes)?;
        let builder =
            NodeBuilder::new().config(&self.config).signal_handling_mode(SignalHandlingMode::Disabled);
        let node = builder.create().map_err(|source| match source {
            iceoryx2::node::NodeCreationFailure::InsufficientPermissions => self.permission(),
            _ => self.failed("signing in at", self.root_path(), source),
        });
        premises::close_management(&self.config);
        node
    }

    /// Signs a consumer in; `None` where there is no `root_path`, so that no driver runs. Who only looks for one makes nothing.
    pub(crate) fn visiting_node(&self) -> Result<Option<Node<Ipc>>, IpcError> {
        if premises::has_root_path(&self.config) {
            return self.node().map(Some);
        }
        premises::check_shared_memory()?;
        Ok(None)
    }

    /// Takes the memory of all small files that were just made or opened, so that nobody meets their absence later.
    pub(crate) fn take_small_files(&self) -> Result<(), IpcError> {
        resident::make_small_files_present(self.config.global.prefix.as_str()).map_err(|source| {
            let full = premises::check_room(0).err();
            full.unwrap_or_else(|| self.failed("taking the memory of files in", SHARED_MEMORY, source))
        })
    }

    /// The files that others find these services, ports and nodes by.
    pub(crate) fn footing(&self, marks: &[String]) -> Footing {
        Footing::of(&self.config, marks)
    }

    /// The driver's side: makes the services, or opens them where consumers hold them from before.
    pub(crate) fn create(
        &self,
        node: &Node<Ipc>,
        settings: &Settings,
    ) -> Result<(FrameService, WakeService), IpcError> {
        self.clear_description(&self.frames, MessagingPattern::PublishSubscribe);
        self.clear_description(&self.wake, MessagingPattern::Event);
        // Room for killed programs that nobody cleaned up yet.
        let max_nodes = 2 * settings.max_subscribers + 2;
        let frames = node
            .service_builder(&self.frames)
            .publish_subscribe::<[u8]>()
            .user_header::<FrameHeader>()
            .max_publishers(1)
            .max_subscribers(settings.max_subscribers)
            .max_nodes(max_nodes)
            .subscriber_max_buffer_size(settings.buffer)
            .subscriber_max_borrowed_samples(settings.borrowed)
            .history_size(0)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|source| self.frames_not_created(source))?;
        let wake = node
            .service_builder(&self.wake)
            .event()
            .max_notifiers(1)
            .max_listeners(settings.max_subscribers)
            .max_nodes(max_nodes)
            .event_id_max_value(0)
            .open_or_create()
            .map_err(|source| self.wake_not_created(source))?;
        Ok((frames, wake))
    }

    /// The consumer's side: opens the services, whatever the numbers they were made with; `None` where they are not there, half made
    /// or half removed.
    pub(crate) fn open(&self, node: &Node<Ipc>) -> Result<Option<(FrameService, WakeService)>, IpcError> {
        if half_made(&self.config).is_some() {
            return Ok(None);
        }
        let frames = node
            .service_builder(&self.frames)
            .publish_subscribe::<[u8]>()
            .user_header::<FrameHeader>()
            .open();
        let frames = match frames {
            Ok(frames) => frames,
            Err(
                OpenFrames::DoesNotExist
                | OpenFrames::ServiceInCorruptedState
                | OpenFrames::IsMarkedForDestruction
                | OpenFrames::HangsInCreation,
            ) => return Ok(None),
            Err(source) => return Err(self.frames_not_opened(source)),
        };
        match node.service_builder(&self.wake).event().open() {
            Ok(wake) => Ok(Some((frames, wake))),
            Err(
                OpenWake::DoesNotExist
                | OpenWake::ServiceInCorruptedState
                | OpenWake::IsMarkedForDestruction
                | OpenWake::HangsInCreation,
            ) => Ok(None),
            Err(source) => Err(self.wake_not_opened(source)),
        }
    }

    /// Whether `frames` is still the service that others find under this name.
    pub(crate) fn leads_to(&self, frames: &FrameService) -> bool {
        let details = Ipc::details(&self.frames, &self.config, MessagingPattern::PublishSubscribe);
        matches!(details, Ok(Some(found)) if found.dynamic_details.is_some()
            && found.static_details.unique_service_id() == frames.unique_service_id())
    }

    /// The driver's side: removes the description of a service whose register is gone, which can be neither opened nor made anew.
    pub(crate) fn clear_description(&self, service: &ServiceName, pattern: MessagingPattern) {
        if let Ok(Some(found)) = Ipc::details(service, &self.config, pattern)
            && found.dynamic_details.is_none()
        {
            let global = &self.config.global;
            let hash = found.static_details.service_hash();
            let suffix = global.service.static_config_storage_suffix;
            let name = format!("{}{hash}{suffix}", global.prefix);
            // What cannot be removed fails when the service is made.
            let _ = std::fs::remove_file(Path::new(&global.service_dir().to_string()).join(name));
        }
    }

    pub(crate) fn failed(
        &self,
        doing: &'static str,
        on: &str,
        source: impl std::error::Error + Send + Sync + 'static,
    ) -> IpcError {
        IpcError::System { doing, on: on.to_owned(), source: Box::new(source) }
    }

    pub(crate) fn frames_name(&self) -> &str {
        self.frames.as_str()
    }

    pub(crate) fn wake_name(&self) -> &str {
        self.wake.as_str()
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

    fn permission(&self) -> IpcError {
        premises::no_access(&self.config)
    }

    fn incompatible(
        &self,
        service: &ServiceName,
        source: impl std::error::Error + Send + Sync + 'static,
    ) -> IpcError {
        IpcError::Incompatible { service: service.as_str().to_owned(), source: Box::new(source) }
    }

    fn frames_not_created(&self, source: PublishSubscribeOpenOrCreateError) -> IpcError {
        use PublishSubscribeOpenOrCreateError::{PublishSubscribeCreateError, PublishSubscribeOpenError};
        match source {
            PublishSubscribeOpenError(open) => self.frames_not_opened(open),
            PublishSubscribeCreateError(CreateFrames::InsufficientPermissions) => self.permission(),
            _ => self.failed("creating service", self.frames.as_str(), source),
        }
    }

    fn wake_not_created(&self, source: EventOpenOrCreateError) -> IpcError {
        match source {
            EventOpenOrCreateError::EventOpenError(open) => self.wake_not_opened(open),
            _ => self.failed("creating service", self.wake.as_str(), source),
        }
    }

    fn frames_not_opened(&self, source: OpenFrames) -> IpcError {
        use OpenFrames::*;
        match source {
            InsufficientPermissions => self.permission(),
            ExceedsMaxNumberOfNodes => IpcError::TooManyConsumers(self.frames.as_str().to_owned()),
            IncompatibleTypes
            | IncompatibleMessagingPattern
            | IncompatibleAttributes
            | IncompatibleOverflowBehavior
            | VersionMismatch
            | DoesNotSupportRequestedMinBufferSize
            | DoesNotSupportRequestedMinHistorySize
            | DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | DoesNotSupportRequestedAmountOfPublishers
            | DoesNotSupportRequestedAmountOfSubscribers
            | DoesNotSupportRequestedAmountOfNodes => self.incompatible(&self.frames, source),
            _ => self.failed("opening service", self.frames.as_str(), source),
        }
    }

    fn wake_not_opened(&self, source: OpenWake) -> IpcError {
        use OpenWake::*;
        match source {
            InsufficientPermissions => self.permission(),
            ExceedsMaxNumberOfNodes => IpcError::TooManyConsumers(self.wake.as_str().to_owned()),
            IncompatibleMessagingPattern
            | VersionMismatch
            | DoesNotSupportRequestedAmountOfNotifiers
            | DoesNotSupportRequestedAmountOfListeners
            | DoesNotSupportRequestedMaxEventId
            | DoesNotSupportRequestedAmountOfNodes => self.incompatible(&self.wake, source),
            _ => self.failed("opening service", self.wake.as_str(), source),
        }
    }
}
