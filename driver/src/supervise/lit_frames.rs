//! Lit frames of a camera: between two epochs of its stream, while it is closed, or where no driver runs.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;

use uvcam_shm_ipc::control::Progress;

use super::{News, Notice, Supervisor};
use crate::camera::{Applied, Camera, CameraError};
use crate::config::{CameraConfig, Ipc};
use crate::error::{Error, with_causes};
use crate::generate::{CancelToken, Collector, LitFrames, Request, Task};

impl Supervisor {
    /// Collects lit frames of a camera that no driver runs, until they suffice or `stop` is set. `progress` is called after each of them.
    ///
    /// # Errors
    /// Those of [`Collector::run`]; [`Error::Camera`] where it cannot be opened; [`Error::NotRestored`] where it does not take its flight
    /// settings back.
    pub fn collect_alone(
        camera: &CameraConfig,
        ipc: &Ipc,
        stop: Arc<AtomicBool>,
        request: Request,
        progress: impl Fn(Progress) + Send + 'static,
    ) -> Result<LitFrames, Error> {
        let (_, commands) = channel();
        let notify = Box::new(move |notice: Notice| {
            if let News::Progress(so_far) = notice.news {
                progress(so_far);
            }
        });
        let mut supervisor =
            Supervisor::new(0, camera.clone(), ipc.clone(), commands, notify, Arc::default(), stop);
        let mut camera = supervisor.open()?;
        supervisor.collect(camera.as_mut(), request, &CancelToken::default()).0
    }

    /// Collects lit frames, and says so when the camera has its flight settings again.
    ///
    /// # Errors
    /// [`CameraError`] where it does not take them back: it is to be dropped.
    pub(super) fn generate(&mut self, camera: &mut dyn Camera, task: Task) -> Result<(), CameraError> {
        let Task { request, cancel } = task;
        let (lit_frames, restored) = self.collect(camera, request, &cancel);
        self.tell(News::Collected(cancel, Box::new(lit_frames)));
        restored.map(drop)
    }

    /// The same for a camera that publishes nothing, which is closed again.
    pub(super) fn generate_while_closed(&mut self, task: Task) {
        match self.open() {
            // What went wrong was told.
            Ok(mut camera) => drop(self.generate(camera.as_mut(), task)),
            Err(error) => self.tell(News::Collected(task.cancel, Box::new(Err(error.into())))),
        }
    }

    /// Lit frames, and what the camera applied when it was given its flight settings back.
    fn collect(
        &mut self,
        camera: &mut dyn Camera,
        request: Request,
        cancel: &CancelToken,
    ) -> (Result<LitFrames, Error>, Result<Applied, CameraError>) {
        let flight = self.camera.settings.clone();
        let collected = self.publisher_for(flight.frame_bytes()).and_then(|publisher| {
            let slots = self.ipc.slots;
            let mut collector =
                Collector { camera: &mut *camera, flight: &flight, publisher: &publisher, slots };
            let is_over = || self.stopped() || cancel.is_cancelled();
            let collected = collector.run(request, is_over, |progress| self.tell(News::Progress(progress)));
            self.publisher = Some(publisher);
            collected
        });
        camera.stop();
        let restored = camera.configure(&flight);
        let collected = match &restored {
            Ok(_) => collected,
            Err(error) => Err(Error::NotRestored(with_causes(error))),
        };
        (collected, restored)
    }
}
