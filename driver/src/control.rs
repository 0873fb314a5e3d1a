//! Where requests reach a running driver, and the reply that tells of an error.

use uvcam_shm_ipc::Footing;
use uvcam_shm_ipc::control::{ActiveRequest, ControlServer, Reply, Request};

use crate::config::Config;
use crate::error::{Error, with_causes};
use crate::exit::Exit;

/// The reply that tells of an error.
pub fn failed(error: &Error) -> Reply {
    Reply::Failed { exit: error.exit() as u8, cause: with_causes(error) }
}

/// Where requests arrive, for each camera.
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

    /// Makes the server of the camera at `camera_index` anew where its files were removed, so that clients find it. No request may be open.
    pub fn keep_open(&mut self, config: &Config, camera_index: usize) {
        let (Some(server), Some(camera)) =
            (self.servers.get_mut(camera_index), config.cameras.get(camera_index))
        else {
            return;
        };
        let create = || ControlServer::create_at_once(&config.ipc.settings, &camera.name);
        if let Err(error) = Footing::keep(server, ControlServer::footing, create) {
            tracing::debug!("control: {error}");
        }
    }

    /// The requests that have arrived, with the index of their camera in the configuration.
    pub fn requests(&self) -> Vec<(usize, ActiveRequest, Request)> {
        let mut requests = Vec::new();
        for (camera_index, server) in self.servers.iter().enumerate() {
            let Some(server) = server else { continue };
            match server.receive() {
                Ok(Some(active)) => match active.text().parse() {
                    Ok(request) => requests.push((camera_index, active, request)),
                    Err(error) => {
                        let cause = format!(
                            "the driver does not know the request: {error}; use the same version of uvcam"
                        );
                        active.reply(&Reply::Failed { exit: Exit::Usage as u8, cause }.to_text());
                    }
                },
                Ok(None) => {}
                Err(error) => tracing::debug!("control: {error}"),
            }
        }
        requests
    }
}
