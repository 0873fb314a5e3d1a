//! Questions to the driver of a camera, and its answers, as text.
//!
//! The service `uvcam/v2/<camera>/control` is request-response: one question has any number of answers. What the texts mean is between
//! the driver and its commands; this file carries them. Nothing here is near the path of a frame.

use std::fmt;
use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::node::Node;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::request_response::RequestResponseOpenError;
use iceoryx2::service::port_factory::request_response;

use crate::cleanup::{cleanup, forget_segments};
use crate::error::IpcError;
use crate::footing::{Footing, Held};
use crate::header::CONTRACT_VERSION;
use crate::premises;
use crate::service::{Address, Ipc};
use crate::settings::Settings;

type Service = request_response::PortFactory<Ipc, [u8], (), [u8], ()>;

/// Longest question and longest answer, bytes.
pub const LONGEST_TEXT: usize = 256 * 1024;
/// Answers that wait for a client that does not look.
const BUFFER: usize = 16;
/// Clients at the same time.
const CLIENTS: usize = 4;
/// Address space of the answers: of each client's question, twice as many as wait for it, and some that are being written.
const MAPPED_BYTES: u64 = (4 * CLIENTS * (BUFFER + 2) * LONGEST_TEXT) as u64;
/// How long [`ControlServer::create`] waits for a predecessor to go.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time between a client's looks for an answer.
const NAP: Duration = Duration::from_millis(10);

/// Name of the service that carries questions to the driver of `camera`.
pub fn control_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/control")
}

/// The driver's end.
pub struct ControlServer {
    server: Server<Ipc, [u8], (), [u8], ()>,
    // A service and its node live as long as their ports.
    _service: Service,
    _node: Node<Ipc>,
    address: Address,
    footing: Footing,
}

/// A question, to be answered any number of times. Dropped, it is over.
pub struct Question {
    text: String,
    request: ActiveRequest<Ipc, [u8], (), [u8], ()>,
}

/// The end of whoever asks.
pub struct ControlClient {
    client: Client<Ipc, [u8], (), [u8], ()>,
    _service: Held<Service>,
    _node: Node<Ipc>,
    address: Address,
}

/// The answers to a question.
pub struct Answers {
    pending: PendingResponse<Ipc, [u8], (), [u8], ()>,
}

/// What came of waiting for an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// An answer.
    Text(String),
    /// None within the time.
    Timeout,
    /// The driver has given its last answer, or is gone.
    Over,
}

impl ControlServer {
    /// Makes the service of `camera`. To be called by the process that publishes it.
    ///
    /// # Errors
    /// [`IpcError::AlreadyPublishing`] where another driver answers for this camera, and those of
    /// [`Publisher::create`](crate::Publisher::create).
    pub fn create(settings: &Settings, camera: &str) -> Result<ControlServer, IpcError> {
        let give_up = Instant::now() + PATIENCE;
        loop {
            match ControlServer::create_at_once(settings, camera) {
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
    /// As [`ControlServer::create`].
    pub fn create_at_once(settings: &Settings, camera: &str) -> Result<ControlServer, IpcError> {
        let (address, name) = address(settings, camera)?;
        // A predecessor that was killed gives its place to this one.
        cleanup(&address.config);
        let node = address.node_with_room_for(premises::FILES + CLIENTS as u64, MAPPED_BYTES)?;
        address.clear_description(&name, MessagingPattern::RequestResponse);
        let service = builder(&node, &name)
            .max_servers(1)
            .max_clients(CLIENTS)
            .max_active_requests_per_client(1)
            .max_response_buffer_size(BUFFER)
            .enable_safe_overflow_for_responses(true)
            .open_or_create()
            .map_err(|source| address.failed("creating service", name.as_str(), source))?;
        if service.dynamic_config().number_of_servers() > 0 {
            return Err(IpcError::AlreadyPublishing(camera.to_owned()));
        }
        let server = service
            .server_builder()
            .initial_max_slice_len(LONGEST_TEXT)
            .allocation_strategy(AllocationStrategy::Static)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|source| {
                forget_segments(&address.config, node.id().value());
                address.failed("creating the server of", name.as_str(), source)
            })?;
        let marks = [
            service.unique_service_id().value().to_string(),
            service.service_hash().to_string(),
            server.id().value().to_string(),
            node.id().value().to_string(),
        ];
        let footing = address.footing(&marks);
        address.take_small_files()?;
        Ok(ControlServer { server, _service: service, _node: node, address, footing })
    }

    /// The files that clients find this server by. Where one is no longer in place, this server is to be dropped, and another one made.
    pub fn footing(&self) -> &Footing {
        &self.footing
    }

    /// The next question, or `None` where there is none; one beyond [`LONGEST_TEXT`] is cut. Never waits.
    ///
    /// # Errors
    /// [`IpcError::System`] where iceoryx2 fails.
    pub fn next(&self) -> Result<Option<Question>, IpcError> {
        let received = self.server.receive();
        let request = received
            .map_err(|source| self.address.failed("receiving from", "the control service", source))?;
        Ok(request.map(|request| {
            let payload = request.payload();
            let text = String::from_utf8_lossy(payload.get(..LONGEST_TEXT).unwrap_or(payload)).into_owned();
            Question { text, request }
        }))
    }
}

impl Question {
    /// What was asked.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Gives an answer; more may follow. Returns whether somebody still waits for it. An answer beyond [`LONGEST_TEXT`] is cut.
    pub fn answer(&self, text: &str) -> bool {
        let bytes = text.as_bytes().get(..text.len().min(LONGEST_TEXT)).unwrap_or_default();
        // Memory of answers is taken when it is first written.
        if premises::check_room(bytes.len() as u64).is_err() {
            return false;
        }
        let sent =
            self.request.loan_slice_uninit(bytes.len()).map(|answer| answer.write_from_slice(bytes).send());
        matches!(sent, Ok(Ok(()))) && self.request.is_connected()
    }

    /// Whether somebody waits for an answer.
    pub fn is_awaited(&self) -> bool {
        self.request.is_connected()
    }
}

impl ControlClient {
    /// Finds the driver of `camera`; `None` where none runs.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, files of another user, a driver of another version.
    pub fn open(settings: &Settings, camera: &str) -> Result<Option<ControlClient>, IpcError> {
        let (address, name) = address(settings, camera)?;
        // A driver that was killed must not be taken for one that runs.
        cleanup(&address.config);
        let Some(node) = address.visiting_node()? else { return Ok(None) };
        let service = match builder(&node, &name).open() {
            Ok(service) => service,
            Err(
                RequestResponseOpenError::DoesNotExist
                | RequestResponseOpenError::ServiceInCorruptedState
                | RequestResponseOpenError::IsMarkedForDestruction
                | RequestResponseOpenError::HangsInCreation,
            ) => return Ok(None),
            Err(source) => return Err(address.failed("opening service", name.as_str(), source)),
        };
        if service.dynamic_config().number_of_servers() == 0 {
            return Ok(None);
        }
        let client = service
            .client_builder()
            .initial_max_slice_len(LONGEST_TEXT)
            .allocation_strategy(AllocationStrategy::Static)
            .create()
            .map_err(|source| address.failed("creating the client of", name.as_str(), source))?;
        address.take_small_files()?;
        Ok(Some(ControlClient {
            client,
            _service: Held::new(service, &address.config),
            _node: node,
            address,
        }))
    }

    /// Asks. One question at a time.
    ///
    /// # Errors
    /// [`IpcError::System`] where the text is longer than [`LONGEST_TEXT`] or iceoryx2 fails, [`IpcError::NoRoom`] where `/dev/shm` is
    /// full.
    pub fn ask(&self, text: &str) -> Result<Answers, IpcError> {
        let failed = |source: Box<dyn std::error::Error + Send + Sync>| IpcError::System {
            doing: "asking",
            on: format!("the driver of camera \"{}\"", self.address.camera),
            source,
        };
        premises::check_room(text.len() as u64)?;
        let request = self.client.loan_slice_uninit(text.len()).map_err(|source| failed(Box::new(source)))?;
        let pending =
            request.write_from_slice(text.as_bytes()).send().map_err(|source| failed(Box::new(source)))?;
        Ok(Answers { pending })
    }
}

impl Answers {
    /// Waits at most `timeout` for the next answer.
    pub fn next(&self, timeout: Duration) -> Answer {
        let begin = Instant::now();
        loop {
            // Asked before the look for an answer: what was sent before the end is still found.
            let over = !self.pending.is_connected();
            match self.pending.receive() {
                Ok(Some(answer)) => {
                    return Answer::Text(String::from_utf8_lossy(answer.payload()).into_owned());
                }
                Ok(None) if over => return Answer::Over,
                Err(_) => return Answer::Over,
                Ok(None) if begin.elapsed() >= timeout => return Answer::Timeout,
                Ok(None) => std::thread::sleep(NAP.min(timeout)),
            }
        }
    }
}

fn address(settings: &Settings, camera: &str) -> Result<(Address, ServiceName), IpcError> {
    let address = Address::new(settings, camera)?;
    let name = ServiceName::new(&control_service_name(camera));
    Ok((address, name.map_err(|_| IpcError::CameraName(camera.to_owned()))?))
}

fn builder(
    node: &Node<Ipc>,
    name: &ServiceName,
) -> iceoryx2::service::builder::request_response::Builder<[u8], (), [u8], (), Ipc> {
    node.service_builder(name).request_response::<[u8], [u8]>()
}

impl fmt::Debug for ControlServer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("ControlServer").field("camera", &self.address.camera).finish_non_exhaustive()
    }
}

impl fmt::Debug for ControlClient {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("ControlClient").field("camera", &self.address.camera).finish_non_exhaustive()
    }
}

impl fmt::Debug for Question {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Question").field("text", &self.text).finish_non_exhaustive()
    }
}

impl fmt::Debug for Answers {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Answers").finish_non_exhaustive()
    }
}
