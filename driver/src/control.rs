//! What the commands and a running driver say to each other: JSON over the control service of a camera.

use serde::{Deserialize, Serialize};
use uvcam_shm_ipc::Footing;
use uvcam_shm_ipc::control::{ActiveRequest, ControlServer};

use crate::config::Config;
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::generator::{Progress, Report, Wish};

/// What can be requested of a driver.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case")]
pub enum Request {
    /// Generate this camera's mask.
    Generate {
        /// How.
        wish: Wish,
        /// Whether to put it in force at once.
        accept: bool,
    },
    /// Read this camera's mask anew.
    ReloadMask,
}

/// What it replies.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "answer", rename_all = "snake_case")]
pub enum Reply {
    /// Lit frames are being collected; more is to come.
    Collecting {
        /// How far that is.
        progress: Progress,
    },
    /// A mask was generated, or refused.
    Generated {
        /// What came of it.
        report: Box<Report>,
    },
    /// It was done.
    Done,
    /// It was not done.
    Failed {
        /// The exit code of a command that fails so.
        exit: u8,
        /// Why.
        cause: String,
    },
}

impl Reply {
    /// The reply that tells of an error.
    pub fn failed(error: &Error) -> Self {
        Reply::Failed { exit: error.exit() as u8, cause: with_causes(error) }
    }

    /// Sends it to whoever made the request, where somebody still waits.
    pub fn send(&self, request: &ActiveRequest) {
        // A value of plain numbers and texts always has a JSON form.
        request.reply(&serde_json::to_string(self).unwrap_or_default());
    }
}

/// Where requests arrive, a place for each camera.
pub struct ControlServers {
    /// One a camera; none where its files were removed and could not be made anew yet.
    servers: Vec<Option<ControlServer>>,
}

impl ControlServers {
    /// Makes one for every configured camera.
    ///
    /// # Errors
    /// [`Error::Ipc`] where another driver replies for one of them.
    pub fn open(config: &Config) -> Result<Self, Error> {
        let servers = config
            .cameras
            .iter()
            .map(|camera| ControlServer::create(&config.ipc.settings, &camera.name).map(Some));
        Ok(ControlServers { servers: servers.collect::<Result<_, _>>()? })
    }

    /// Makes the server of the camera at `place` anew where its files were removed, so that clients find it. No request may be open.
    pub fn keep_open(&mut self, config: &Config, place: usize) {
        let (Some(server), Some(camera)) = (self.servers.get_mut(place), config.cameras.get(place)) else {
            return;
        };
        let create = || ControlServer::create_at_once(&config.ipc.settings, &camera.name);
        if let Err(error) = Footing::keep(server, ControlServer::footing, create) {
            tracing::debug!("control: {error}");
        }
    }

    /// The requests that have arrived, with the place of their camera in the configuration.
    pub fn requests(&self) -> Vec<(usize, ActiveRequest, Request)> {
        let mut requests = Vec::new();
        let servers = self.servers.iter().enumerate();
        for (place, server) in servers.filter_map(|(place, server)| Some((place, server.as_ref()?))) {
            match server.receive() {
                Ok(Some(request)) => match serde_json::from_str(request.text()) {
                    Ok(wanted) => requests.push((place, request, wanted)),
                    Err(error) => {
                        let cause = format!(
                            "the driver does not know the request: {error}; use the same version of uvcam"
                        );
                        Reply::Failed { exit: Exit::Usage as u8, cause }.send(&request);
                    }
                },
                Ok(None) => {}
                Err(error) => tracing::debug!("control: {error}"),
            }
        }
        requests
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn numbers_arrive_as_they_were_sent() {
        for number in [3e93, 1000.1, 0.1 + 0.2] {
            let text = serde_json::to_string(&number).unwrap();
            assert_eq!(serde_json::from_str::<f64>(&text).unwrap(), number);
        }
    }
}
