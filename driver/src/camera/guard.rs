//! The order of calls and the size of slots, watched over in one place for all kinds of cameras.

use std::time::Duration;

use uvcam_shm_ipc::Slot;

use super::{Applied, Camera, CameraError, Event, Identity, Settings};
use crate::clock::DeviceClock;

/// A camera behind its guard, which lets through only calls that make sense. No camera sees another order of calls than this:
///
/// ```text
///          configure          start
/// Opened -----------> Ready <=======> Started
///                    (queue)   stop    (queue, next)
/// ```
///
/// `configure` is let through everywhere, after a `stop`; a `configure` or `start` that fails leads back to the beginning.
pub(super) struct Guard {
    camera: Box<dyn Camera>,
    state: State,
}

/// How far a camera has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// It has no settings that hold.
    Opened,
    /// It is configured, and does not run.
    Ready { payload_bytes: usize },
    /// It fills slots.
    Started { payload_bytes: usize },
}

impl State {
    /// The size of a slot.
    ///
    /// # Errors
    /// What is wrong, where it is not configured.
    fn payload_bytes(self) -> Result<usize, String> {
        match self {
            State::Opened => Err("it is not configured".into()),
            State::Ready { payload_bytes } | State::Started { payload_bytes } => Ok(payload_bytes),
        }
    }
}

impl Guard {
    pub(super) fn new(camera: Box<dyn Camera>) -> Self {
        Guard { camera, state: State::Opened }
    }

    #[cold]
    fn refused(&self, doing: &'static str, cause: String) -> CameraError {
        CameraError::Device { serial: self.identity().serial.clone(), doing, cause }
    }
}

impl Camera for Guard {
    fn identity(&self) -> &Identity {
        self.camera.identity()
    }

    fn device_clock(&self) -> DeviceClock {
        self.camera.device_clock()
    }

    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        self.stop();
        self.state = State::Opened;
        let applied = self.camera.configure(settings)?;
        self.state = State::Ready { payload_bytes: applied.payload_bytes };
        Ok(applied)
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        let payload_bytes = self.state.payload_bytes().map_err(|cause| self.refused("queueing", cause))?;
        if slot.len() != payload_bytes {
            let cause = format!("the slot has {} bytes, a frame {payload_bytes}", slot.len());
            return Err(self.refused("queueing", cause));
        }
        self.camera.queue(slot)
    }

    fn start(&mut self) -> Result<(), CameraError> {
        let payload_bytes = self.state.payload_bytes().map_err(|cause| self.refused("starting", cause))?;
        if let State::Started { .. } = self.state {
            return Err(self.refused("starting", "it is started already".into()));
        }
        // One that failed half way may hold slots and run.
        self.state = State::Opened;
        self.camera.start()?;
        self.state = State::Started { payload_bytes };
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        match self.state {
            State::Started { .. } => self.camera.next(timeout),
            _ => Err(self.refused("streaming", "it is not started".into())),
        }
    }

    fn temperature_c(&mut self) -> Option<f64> {
        self.camera.temperature_c()
    }

    fn stop(&mut self) {
        self.camera.stop();
        if let State::Started { payload_bytes } = self.state {
            self.state = State::Ready { payload_bytes };
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use uvcam_shm_ipc::Publisher;

    use super::*;
    use crate::frame_path::tests::{Place, identity};

    /// A camera that writes down what reaches it, and fails when it is told to.
    struct Recorder {
        identity: Identity,
        calls: Arc<Mutex<Vec<&'static str>>>,
        fails: bool,
    }

    impl Recorder {
        fn call(&self, name: &'static str) -> Result<(), CameraError> {
            self.calls.lock().unwrap().push(name);
            match self.fails {
                true => Err(CameraError::Disconnected { serial: String::new(), doing: name }),
                false => Ok(()),
            }
        }
    }

    impl Camera for Recorder {
        fn identity(&self) -> &Identity {
            &self.identity
        }

        fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
            // Asked for, so that a test can make it fail.
            self.fails = settings.fps == 0.0;
            self.call("configure")?;
            self.fails = settings.gain_db > 0.0;
            Ok(Applied::exactly(settings))
        }

        fn queue(&mut self, _: Slot) -> Result<(), CameraError> {
            self.call("queue")
        }

        fn start(&mut self) -> Result<(), CameraError> {
            self.call("start")
        }

        fn next(&mut self, _: Duration) -> Result<Event, CameraError> {
            self.call("next").map(|()| Event::Timeout)
        }

        fn stop(&mut self) {
            self.calls.lock().unwrap().push("stop");
        }
    }

    fn guarded() -> (Guard, Arc<Mutex<Vec<&'static str>>>) {
        let calls: Arc<Mutex<Vec<&'static str>>> = Arc::default();
        let recorder = Recorder { identity: identity(), calls: calls.clone(), fails: false };
        (Guard::new(Box::new(recorder)), calls)
    }

    const SETTINGS: Settings = Settings::new(8, 4, 50.0, 1000.0);
    const NO_SETTINGS: Settings = Settings { fps: 0.0, ..SETTINGS };
    const NO_START: Settings = Settings { gain_db: 1.0, ..SETTINGS };

    fn refusal<T: std::fmt::Debug>(outcome: Result<T, CameraError>) -> String {
        match outcome {
            Err(error @ CameraError::Device { .. }) => error.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn calls_in_their_order_are_let_through() {
        let (mut guard, calls) = guarded();
        let place = Place::new();
        let publisher = Publisher::create(&place.settings, "left", 32, 3).unwrap();
        guard.configure(&SETTINGS).unwrap();
        guard.queue(publisher.loan().unwrap()).unwrap();
        guard.start().unwrap();
        guard.queue(publisher.loan().unwrap()).unwrap();
        assert!(matches!(guard.next(Duration::ZERO), Ok(Event::Timeout)));
        guard.stop();
        guard.queue(publisher.loan().unwrap()).unwrap();
        guard.start().unwrap();
        let expected = ["stop", "configure", "queue", "start", "queue", "next", "stop", "queue", "start"];
        assert_eq!(*calls.lock().unwrap(), expected);
    }

    #[test]
    fn a_slot_of_another_size_reaches_no_camera() {
        let (mut guard, calls) = guarded();
        let place = Place::new();
        let publisher = Publisher::create(&place.settings, "left", 33, 1).unwrap();
        let message = refusal(guard.queue(publisher.loan().unwrap()));
        assert_eq!(message, "camera  failed while queueing: it is not configured");
        guard.configure(&SETTINGS).unwrap();
        let message = refusal(guard.queue(publisher.loan().unwrap()));
        assert_eq!(message, "camera  failed while queueing: the slot has 33 bytes, a frame 32");
        assert_eq!(*calls.lock().unwrap(), ["stop", "configure"]);
        assert!(publisher.loan().is_ok(), "the slot went back");
    }

    #[test]
    fn calls_out_of_order_reach_no_camera() {
        let (mut guard, calls) = guarded();
        assert_eq!(refusal(guard.start()), "camera  failed while starting: it is not configured");
        assert_eq!(refusal(guard.next(Duration::ZERO)), "camera  failed while streaming: it is not started");
        guard.configure(&SETTINGS).unwrap();
        assert_eq!(refusal(guard.next(Duration::ZERO)), "camera  failed while streaming: it is not started");
        guard.start().unwrap();
        assert_eq!(refusal(guard.start()), "camera  failed while starting: it is started already");
        guard.stop();
        assert_eq!(refusal(guard.next(Duration::ZERO)), "camera  failed while streaming: it is not started");
        assert_eq!(*calls.lock().unwrap(), ["stop", "configure", "start", "stop"]);
    }

    #[test]
    fn a_camera_that_took_no_settings_is_not_configured_any_more() {
        let (mut guard, calls) = guarded();
        guard.configure(&SETTINGS).unwrap();
        guard.start().unwrap();
        assert!(matches!(guard.configure(&NO_SETTINGS), Err(CameraError::Disconnected { .. })));
        assert_eq!(refusal(guard.start()), "camera  failed while starting: it is not configured");
        assert_eq!(*calls.lock().unwrap(), ["stop", "configure", "start", "stop", "configure"]);
    }

    #[test]
    fn a_camera_that_failed_to_start_is_configured_anew_first() {
        let (mut guard, _) = guarded();
        guard.configure(&NO_START).unwrap();
        assert!(matches!(guard.start(), Err(CameraError::Disconnected { .. })));
        assert_eq!(refusal(guard.start()), "camera  failed while starting: it is not configured");
        guard.configure(&SETTINGS).unwrap();
        guard.start().unwrap();
    }
}
