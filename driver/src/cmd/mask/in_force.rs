//! `uvcam mask accept`, `discard`, `history` and `restore`: which mask a camera flies.

use std::time::Duration;

use uvcam_masker::{Mask, file};
use uvcam_shm_ipc::control::{Answer, ControlClient};

use crate::config::{CameraConfig, Config};
use crate::control::{Ask, Reply};
use crate::error::Error;
use crate::exit::Exit;
use crate::generator::store_of;
use crate::mask_store::MaskStore;

/// How long a running driver may take to read a mask.
const PATIENCE: Duration = Duration::from_secs(10);

/// Changes which mask is in force, and tells a running driver.
pub(super) fn change(
    name: &str,
    config: &Config,
    change: impl FnOnce(&MaskStore) -> Result<(), Error>,
) -> Result<Exit, Error> {
    let camera = camera(name, config)?;
    let store = store_of(camera)?;
    change(&store)?;
    let mask = Mask::load(store.in_force()).map_err(Error::MaskFile)?;
    let flies = match ControlClient::open(&config.ipc.settings, name)? {
        Some(driver) => {
            reload(&driver)?;
            "the running driver flies it"
        }
        None => "the next driver flies it",
    };
    tracing::info!("{name}: mask {} is in force, {flies}", mask.id());
    Ok(Exit::Done)
}

fn reload(driver: &ControlClient) -> Result<(), Error> {
    // A value without fields always has a JSON form.
    let answers = driver.ask(&serde_json::to_string(&Ask::ReloadMask).unwrap_or_default())?;
    let cause = match answers.next(PATIENCE) {
        Answer::Text(text) => match serde_json::from_str(&text) {
            Ok(Reply::Done) => return Ok(()),
            Ok(Reply::Failed { exit, cause }) => return Err(Error::Driver { exit, cause }),
            _ => "it answers in another version; use the same version of uvcam",
        },
        Answer::Timeout | Answer::Over => "it did not answer; send it SIGHUP, or start it again",
    };
    Err(Error::Driver { exit: Exit::SharedMemory as u8, cause: cause.into() })
}

pub(super) fn discard(name: &str, config: &Config) -> Result<Exit, Error> {
    store_of(camera(name, config)?)?.discard()?;
    Ok(Exit::Done)
}

pub(super) fn history(name: &str, config: &Config) -> Result<Exit, Error> {
    for (number, path) in (1..).zip(store_of(camera(name, config)?)?.history()?) {
        let mask = Mask::load(&path).map_err(Error::MaskFile)?;
        let texts = file::read_texts(&path)?;
        let made = texts
            .iter()
            .find(|(keyword, _)| keyword == "Creation Time")
            .map_or("?", |(_, text)| text.as_str());
        super::super::print(&format!(
            "{number}  {}  {} px  made {made}  {}",
            mask.id(),
            mask.masked_px(),
            path.display()
        ))?;
    }
    Ok(Exit::Done)
}

fn camera<'a>(name: &str, config: &'a Config) -> Result<&'a CameraConfig, Error> {
    config
        .cameras
        .iter()
        .find(|camera| camera.name == name)
        .ok_or_else(|| Error::Usage(format!("no camera \"{name}\" in the configuration")))
}
