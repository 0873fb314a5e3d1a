//! `uvcam mask accept`, `discard`, `history` and `restore`: which mask a camera flies.

use std::path::Path;
use std::time::Duration;

use uvcam_masker::{Mask, file};
use uvcam_shm_ipc::control::{ControlClient, NextReply, Reply, Request};

use crate::config::{CameraConfig, Config};
use crate::error::{Error, with_causes};
use crate::exit::Exit;
use crate::mask::{self, Flyable};
use crate::mask_store::MaskStore;

/// How long a running driver may take to read a mask.
const PATIENCE: Duration = Duration::from_secs(10);

/// Changes which mask is in force, and tells a running driver.
pub(super) fn change(
    name: &str,
    config: &Config,
    change: impl FnOnce(&MaskStore, (u32, u32)) -> Result<Mask, Error>,
) -> Result<Exit, Error> {
    let camera = camera(name, config)?;
    let store = MaskStore::of(camera)?;
    // First of all: whoever may not speak to the driver changes nothing that it would have to hear of.
    let driver = ControlClient::open(&config.ipc.settings, name)?;
    let mask = change(&store, size(camera))?;
    let flies = match driver {
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
    let replies = driver.request(&Request::ReloadMask.to_text())?;
    let cause = match replies.receive(PATIENCE) {
        NextReply::Text(text) => match text.parse() {
            Ok(Reply::Done) => return Ok(()),
            Ok(Reply::Failed { exit, cause }) => return Err(Error::Driver { exit, cause }),
            _ => "it answers in another version; use the same version of uvcam",
        },
        NextReply::Timeout | NextReply::Over => "it did not answer; send it SIGHUP, or start it again",
    };
    Err(Error::Driver { exit: Exit::SharedMemory as u8, cause: cause.into() })
}

pub(super) fn discard(name: &str, config: &Config) -> Result<Exit, Error> {
    MaskStore::of(camera(name, config)?)?.discard()?;
    Ok(Exit::Done)
}

pub(super) fn history(name: &str, config: &Config) -> Result<Exit, Error> {
    let camera = camera(name, config)?;
    for (number, path) in (1..).zip(MaskStore::of(camera)?.history()?) {
        let file = path.display();
        let line = match mask::read(&path, size(camera)) {
            Ok(Flyable { mask, .. }) => {
                format!("{number}  {}  {} px  made {}  {file}", mask.id(), mask.masked_px(), made(&path))
            }
            // The others are no worse for it.
            Err(error) => format!("{number}  must not fly: {}  {file}", with_causes(&error)),
        };
        super::super::print(&line)?;
    }
    Ok(Exit::Done)
}

/// When the mask was made, as its file tells.
fn made(path: &Path) -> String {
    let texts = file::read_texts(path).unwrap_or_default();
    let time = texts.into_iter().find(|(keyword, _)| keyword == "Creation Time");
    time.map_or_else(|| "?".into(), |(_, time)| time)
}

/// Width and height of the camera's frames.
fn size(camera: &CameraConfig) -> (u32, u32) {
    (camera.settings.width, camera.settings.height)
}

fn camera<'a>(name: &str, config: &'a Config) -> Result<&'a CameraConfig, Error> {
    config
        .cameras
        .iter()
        .find(|camera| camera.name == name)
        .ok_or_else(|| Error::Usage(format!("no camera \"{name}\" in the configuration")))
}
