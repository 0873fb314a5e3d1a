//! Requests to the driver of a camera, and its replies.
//!
//! The service `uvcam/v2/<camera>/control` is request-response: one request has any number of replies. A [`Request`] and a [`Reply`] go as
//! text, which this file carries. Nothing here is near the path of a frame.

use std::fmt;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::{client, server};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::request_response::Builder;
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::request_response;

use crate::cleanup::forget_segments;
use crate::error::{Fault, IpcError};
use crate::footing::Footing;
use crate::header::CONTRACT_VERSION;
use crate::premises;
use crate::quirks::Ipc;
use crate::service::{Plan, Served, Visited, patiently};
use crate::settings::Settings;

mod bounds;
mod message;

pub use bounds::{Bounds, EXPOSURE_US, FRAMES, GAIN_DB};
pub use message::{
    Finding, GenerateReport, GenerateRequest, Method, Part, Progress, Reply, Request, UnknownMessage, Verdict,
};

type Service = request_response::PortFactory<Ipc, [u8], (), [u8], ()>;
type Server = server::Server<Ipc, [u8], (), [u8], ()>;
type Client = client::Client<Ipc, [u8], (), [u8], ()>;

/// Longest request and longest reply, bytes.
pub const LONGEST_TEXT: usize = 256 * 1024;
/// Replies that wait for a client that does not look.
const BUFFER: usize = 16;
/// Clients at the same time.
const CLIENTS: usize = 4;
/// Address space of the replies: for each client's request, twice as many as wait for it, and some that are being written.
const MAPPED_BYTES: u64 = (4 * CLIENTS * (BUFFER + 2) * LONGEST_TEXT) as u64;
/// Time between a client's looks for a reply.
const NAP: Duration = Duration::from_millis(10);

/// Name of the service that carries requests to the driver of `camera`.
pub fn control_service_name(camera: &str) -> String {
    format!("uvcam/v{CONTRACT_VERSION}/{camera}/control")
}

/// The driver's end.
#[derive(Debug)]
pub struct ControlServer(Served<Server, Service>);

/// A request that has arrived, to be replied to any number of times. Dropped, it is over.
pub struct ActiveRequest {
    text: String,
    request: iceoryx2::active_request::ActiveRequest<Ipc, [u8], (), [u8], ()>,
}

/// The end of whoever has a request.
#[derive(Debug)]
pub struct ControlClient(Visited<Client, Service>);

/// The replies to a request.
pub struct Replies {
    pending: PendingResponse<Ipc, [u8], (), [u8], ()>,
}

/// What came of waiting for a reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NextReply {
    /// A reply.
    Text(String),
    /// None within the time.
    Timeout,
    /// The driver has given its last reply, or is gone.
    Over,
}

impl ControlServer {
    /// Makes the service of `camera`. To be called by the process that publishes it. A predecessor that is just stopping gets 3 s to go.
    ///
    /// # Errors
    /// [`IpcErrorKind::AlreadyPublishing`](crate::IpcErrorKind::AlreadyPublishing) where another driver replies for this camera, and those of
    /// [`Publisher::create`](crate::Publisher::create).
    pub fn create(settings: &Settings, camera: &str) -> Result<ControlServer, IpcError> {
        patiently(|| ControlServer::create_at_once(settings, camera))
    }

    /// The same, without waiting for a predecessor.
    ///
    /// # Errors
    /// As [`ControlServer::create`].
    pub fn create_at_once(settings: &Settings, camera: &str) -> Result<ControlServer, IpcError> {
        let plan = Plan {
            name: control_service_name(camera),
            pattern: MessagingPattern::RequestResponse,
            files: premises::FILES + CLIENTS as u64,
            mapped_bytes: MAPPED_BYTES,
        };
        let served = Served::create(settings, camera, plan, |address, node, name| {
            let created = builder(node, name)
                .max_servers(1)
                .max_clients(CLIENTS)
                .max_active_requests_per_client(1)
                .max_response_buffer_size(BUFFER)
                .enable_safe_overflow_for_responses(true)
                .open_or_create();
            let service = address.created(name, created)?;
            if service.dynamic_config().number_of_servers() > 0 {
                return Err(Fault::AlreadyPublishing(camera.to_owned()).into());
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
            let number = server.id().value();
            Ok((service, server, number))
        })?;
        Ok(ControlServer(served))
    }

    /// The files that clients find this server by. Where one is no longer in place, this server is to be dropped, and another one made.
    pub fn footing(&self) -> &Footing {
        &self.0.footing
    }

    /// The next request, or `None` where there is none; one beyond [`LONGEST_TEXT`] is cut. Never waits.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails.
    pub fn receive(&self) -> Result<Option<ActiveRequest>, IpcError> {
        let Served { port, address, .. } = &self.0;
        let request = port
            .receive()
            .map_err(|source| address.failed("receiving from", "the control service", source))?;
        Ok(request.map(|request| {
            let payload = request.payload();
            let text = String::from_utf8_lossy(payload.get(..LONGEST_TEXT).unwrap_or(payload)).into_owned();
            ActiveRequest { text, request }
        }))
    }
}

impl ActiveRequest {
    /// The request.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Gives a reply; more may follow. Returns whether somebody still waits for it. A reply beyond [`LONGEST_TEXT`] is cut.
    pub fn reply(&self, text: &str) -> bool {
        let bytes = text.as_bytes().get(..text.len().min(LONGEST_TEXT)).unwrap_or_default();
        // Memory of replies is taken when it is first written.
        if premises::check_room(bytes.len() as u64).is_err() {
            return false;
        }
        let sent =
            self.request.loan_slice_uninit(bytes.len()).map(|reply| reply.write_from_slice(bytes).send());
        matches!(sent, Ok(Ok(()))) && self.request.is_connected()
    }

    /// Whether somebody waits for a reply.
    pub fn is_awaited(&self) -> bool {
        self.request.is_connected()
    }
}

impl ControlClient {
    /// Finds the driver of `camera`; `None` where none runs.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, files of another user, a driver of another version, or as many clients as
    /// there can be.
    pub fn open(settings: &Settings, camera: &str) -> Result<Option<ControlClient>, IpcError> {
        let name = control_service_name(camera);
        let end = Visited::open(settings, camera, &name, |address, node, name| {
            let Some(service) = address.opened(name, builder(node, name).open())? else { return Ok(None) };
            if service.dynamic_config().number_of_servers() == 0 {
                return Ok(None);
            }
            let client = service
                .client_builder()
                .initial_max_slice_len(LONGEST_TEXT)
                .allocation_strategy(AllocationStrategy::Static)
                .create()
                .map_err(|source| match source {
                    ClientCreateError::ExceedsMaxSupportedClients => {
                        Fault::TooManyConsumers(name.as_str().to_owned()).into()
                    }
                    _ => address.failed("creating the client of", name.as_str(), source),
                })?;
            Ok(Some((service, client)))
        })?;
        Ok(end.map(ControlClient))
    }

    /// Sends a request. One at a time.
    ///
    /// # Errors
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where the text is longer than [`LONGEST_TEXT`] or iceoryx2 fails, [`IpcErrorKind::NoRoom`](crate::IpcErrorKind::NoRoom) where `/dev/shm` is
    /// full.
    pub fn request(&self, text: &str) -> Result<Replies, IpcError> {
        let Visited { port, address, .. } = &self.0;
        let failed = |source: Box<dyn std::error::Error + Send + Sync>| {
            let on = format!("the driver of camera \"{}\"", address.camera);
            IpcError::from(Fault::System { doing: "asking", on, source })
        };
        premises::check_room(text.len() as u64)?;
        let request = port.loan_slice_uninit(text.len()).map_err(|source| failed(Box::new(source)))?;
        let pending =
            request.write_from_slice(text.as_bytes()).send().map_err(|source| failed(Box::new(source)))?;
        Ok(Replies { pending })
    }
}

impl Replies {
    /// Waits at most `timeout` for the next reply.
    pub fn receive(&self, timeout: Duration) -> NextReply {
        let begin = Instant::now();
        loop {
            // Looked at before the look for a reply: what was sent before the end is still found.
            let over = !self.pending.is_connected();
            match self.pending.receive() {
                Ok(Some(reply)) => {
                    return NextReply::Text(String::from_utf8_lossy(reply.payload()).into_owned());
                }
                Ok(None) if over => return NextReply::Over,
                Err(_) => return NextReply::Over,
                Ok(None) if begin.elapsed() >= timeout => return NextReply::Timeout,
                Ok(None) => std::thread::sleep(NAP.min(timeout)),
            }
        }
    }
}

fn builder(node: &Node<Ipc>, name: &ServiceName) -> Builder<[u8], (), [u8], (), Ipc> {
    node.service_builder(name).request_response::<[u8], [u8]>()
}

impl fmt::Debug for ActiveRequest {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("ActiveRequest").field("text", &self.text).finish_non_exhaustive()
    }
}

impl fmt::Debug for Replies {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Replies").finish_non_exhaustive()
    }
}
