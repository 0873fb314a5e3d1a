//! Gives consumers the mask that a camera flies: before its first frame, and to those who come later.
//!
//! Nothing here is on the path of a frame: the camera's thread gives the mask that it begins an epoch with, the main thread one that is to be
//! flown next, before the path hears of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use uvcam_shm_ipc::mask::{MaskPublisher, NewMask, Run};
use uvcam_shm_ipc::{IpcError, Settings};

use super::{FlyingMask, MaskInForce};

/// The service of one camera's mask; none is made for a camera without.
#[derive(Debug)]
pub struct MaskService {
    settings: Settings,
    camera: String,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    publisher: Option<MaskPublisher>,
    /// What newcomers are to get.
    given: MaskInForce,
}

impl MaskService {
    /// Prepares the service of a camera; nothing is made yet.
    pub fn new(settings: &Settings, camera: &str) -> Self {
        MaskService { settings: settings.clone(), camera: camera.to_owned(), state: Mutex::default() }
    }

    /// Gives out the mask that an epoch begins with. Where a newer one was given out already, which the path is about to hear of, newcomers
    /// still get that one.
    ///
    /// # Errors
    /// [`IpcError`]: no frame may go out under this mask.
    pub fn begin(&self, mask: &MaskInForce) -> Result<(), IpcError> {
        let Some(mask) = mask else { return Ok(()) };
        let mut state = self.state();
        let newer = state.given.clone().filter(|given| given.id() != mask.id());
        if newer.is_some() || !state.is_open() {
            self.send(&mut state, mask)?;
        }
        newer.map_or(Ok(()), |newer| self.send(&mut state, &newer))
    }

    /// Gives out the mask that is to be flown next.
    ///
    /// # Errors
    /// As [`MaskService::begin`].
    pub fn give(&self, mask: &MaskInForce) -> Result<(), IpcError> {
        mask.as_ref().map_or(Ok(()), |mask| self.send(&mut self.state(), mask))
    }

    /// Makes the service anew where its files were removed, so that consumers find it. To be called about once a second.
    pub fn keep_open(&self) {
        // Who holds it is just giving out a mask.
        let Some(mut state) = self.try_state() else { return };
        if let Some(given) = state.given.clone().filter(|_| !state.is_open())
            && let Err(error) = self.send(&mut state, &given)
        {
            tracing::debug!("{}: mask: {error}", self.camera);
        }
    }

    /// Gives the newest mask to consumers that have come since. To be called a few times a second.
    pub fn serve_newcomers(&self) {
        let state = self.try_state();
        let publisher = state.as_ref().and_then(|state| state.publisher.as_ref());
        if let Some(Err(error)) = publisher.map(MaskPublisher::serve_newcomers) {
            tracing::debug!("{}: mask: {error}", self.camera);
        }
    }

    fn send(&self, state: &mut State, mask: &Arc<FlyingMask>) -> Result<(), IpcError> {
        let runs = mask.runs().iter();
        let runs: Vec<Run> =
            runs.map(|run| Run { row: run.row, start: run.start, length: run.length }).collect();
        let new = NewMask {
            mask_id: mask.id().0,
            width: mask.width(),
            height: mask.height(),
            runs: &runs,
            provenance: mask.provenance(),
        };
        let fits =
            |publisher: &MaskPublisher| publisher.footing().is_in_place() && publisher.has_room_for(&new);
        // One must be gone before its successor comes: their files have the same names.
        let publisher = match state.publisher.take().filter(fits) {
            Some(publisher) => publisher,
            None => MaskPublisher::create(&self.settings, &self.camera, &new)?,
        };
        state.publisher.insert(publisher).publish(&new)?;
        state.given = Some(mask.clone());
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn try_state(&self) -> Option<MutexGuard<'_, State>> {
        match self.state.try_lock() {
            Ok(state) => Some(state),
            Err(TryLockError::Poisoned(state)) => Some(state.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

impl State {
    /// Whether consumers find what was given out.
    fn is_open(&self) -> bool {
        self.given.is_some()
            && self.publisher.as_ref().is_some_and(|publisher| publisher.footing().is_in_place())
    }
}

#[cfg(test)]
mod tests {
    use uvcam_masker::Mask;
    use uvcam_shm_ipc::{FrameHeader, IpcErrorKind, PixelFormat, Publisher, Subscriber};

    use super::*;
    use crate::config::MaskMode;
    use crate::frame_path::tests::Place;
    use crate::mask::mark;

    const SIDE: u32 = 8;

    fn mask(columns: u32) -> MaskInForce {
        Some(Arc::new(FlyingMask::new(Mask::from_fn(SIDE, SIDE, |x, _| x < columns), MaskMode::Blank)))
    }

    /// Whether a consumer gets this mask for a frame that names it.
    fn finds(
        service: &MaskService,
        publisher: &mut Publisher,
        subscriber: &mut Subscriber,
        mask: &MaskInForce,
    ) -> bool {
        let mut header = FrameHeader::new(SIDE, SIDE, SIDE, PixelFormat::Mono8);
        mark(&mut header, mask);
        publisher.publish(publisher.loan().unwrap(), &header).unwrap();
        let frame = subscriber.receive_latest().unwrap().unwrap();
        // The first call opens, the second receives what newcomers are given.
        for _ in 0..2 {
            match subscriber.mask_of(&frame) {
                Ok(found) => return found.unwrap().id() == mask.as_ref().unwrap().id().0,
                Err(error) => assert_eq!(error.kind(), IpcErrorKind::MaskPending, "{error}"),
            }
            service.serve_newcomers();
        }
        false
    }

    #[test]
    fn a_mask_is_given_before_its_frames_and_the_newest_to_newcomers() {
        let place = Place::new();
        let mut publisher = Publisher::create(&place.settings, "left", (SIDE * SIDE) as usize, 2).unwrap();
        let service = MaskService::new(&place.settings, "left");
        let mut early = Subscriber::open(&place.settings, "left").unwrap();
        service.begin(&mask(1)).unwrap();
        assert!(finds(&service, &mut publisher, &mut early, &mask(1)));
        service.give(&mask(2)).unwrap();
        assert!(finds(&service, &mut publisher, &mut early, &mask(2)));
        // A camera that comes back begins with what it flew, while the next one is on its way.
        service.give(&mask(3)).unwrap();
        service.begin(&mask(2)).unwrap();
        let mut late = Subscriber::open(&place.settings, "left").unwrap();
        assert!(finds(&service, &mut publisher, &mut early, &mask(2)));
        assert!(finds(&service, &mut publisher, &mut late, &mask(3)));
        drop(service);
        let service = MaskService::new(&place.settings, "left");
        service.begin(&mask(4)).unwrap();
        assert!(finds(&service, &mut publisher, &mut late, &mask(4)), "of the next driver");
    }

    #[test]
    fn removed_files_are_made_anew_and_nothing_is_made_without_a_mask() {
        let place = Place::new();
        let mut publisher = Publisher::create(&place.settings, "left", (SIDE * SIDE) as usize, 2).unwrap();
        let service = MaskService::new(&place.settings, "left");
        let services = || std::fs::read_dir(place.settings.root_path.join("services")).unwrap().flatten();
        let before = services().count();
        service.begin(&None).unwrap();
        service.give(&None).unwrap();
        service.keep_open();
        assert_eq!(services().count(), before);
        service.begin(&mask(1)).unwrap();
        assert_eq!(services().count(), before + 1);
        services().for_each(|file| {
            let text = std::fs::read_to_string(file.path()).unwrap();
            if text.contains("left/mask") {
                std::fs::remove_file(file.path()).unwrap();
            }
        });
        service.keep_open();
        assert_eq!(services().count(), before + 1);
        let mut subscriber = Subscriber::open(&place.settings, "left").unwrap();
        assert!(finds(&service, &mut publisher, &mut subscriber, &mask(1)));
    }
}
