//! A simulated camera: an airframe under a moving lamp, blinking markers, sensor noise, and faults by script.
//!
//! `Device` is the hardware: it outlives an unplugging and remembers which faults have happened. `SimulatedCamera` is the
//! opened handle.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use uvcam_masker::file::MAX_PIXELS;
use uvcam_shm_ipc::{Flags, Slot, monotonic_ns};

use super::paced::{Paced, deadline, sleep_until};
use super::source::{CameraSource, FaultKind, Simulated};
use super::{Applied, Camera, CameraError, Capture, Event, Identity, Settings, verify};

mod scene;

use scene::Scene;
pub use scene::airframe;

/// What it tells of its temperature, degrees Celsius.
const TEMPERATURE_C: f64 = 40.0;

/// The simulated hardware. Clones are the same device.
#[derive(Debug, Clone)]
pub(super) struct Device {
    script: Arc<Simulated>,
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    /// Frames exposed since the device was made, over all openings.
    exposed: u64,
    /// Faults of the script that have begun.
    begun: usize,
    unplugged_until: Option<Instant>,
    frozen_until: Option<Instant>,
    /// Frames still to be spoilt by the fault that is under way.
    lose: u64,
    tear: u64,
    /// Times that the next configurations are not what was asked.
    misconfigure: u64,
    /// Memory that was taken and is of no use to anybody.
    leaked: Vec<Vec<u8>>,
    /// What it looks at with these settings: a device that is opened again need not draw it anew.
    scene: Option<(Settings, Arc<Scene>)>,
}

impl Device {
    /// A device that behaves as the script says.
    pub(super) fn new(script: Simulated) -> Self {
        Device { script: Arc::new(script), state: Arc::default() }
    }

    /// Opens the camera.
    ///
    /// # Errors
    /// [`CameraError::Absent`] while it is unplugged.
    fn open_camera(&self) -> Result<SimulatedCamera, CameraError> {
        if self.state().unplugged_until.is_some_and(|until| Instant::now() < until) {
            return Err(CameraError::Absent {
                kind: "simulated",
                wanted: self.script.serial.clone(),
                found: "none (unplugged by its script)".into(),
            });
        }
        Ok(SimulatedCamera {
            identity: Identity {
                kind: "simulated",
                vendor: "uvcam".into(),
                model: "simulated".into(),
                serial: self.script.serial.clone(),
                transport: "none".into(),
                address: "none".into(),
            },
            device: self.clone(),
            scene: None,
            paced: Paced::default(),
            fps: 0.0,
        })
    }

    fn misconfigures(&self) -> bool {
        let mut state = self.state();
        let is_wrong = state.misconfigure > 0;
        state.misconfigure = state.misconfigure.saturating_sub(1);
        is_wrong
    }

    fn scene(&self, settings: &Settings, draw: impl FnOnce() -> Scene) -> Arc<Scene> {
        let mut state = self.state();
        match &state.scene {
            Some((drawn_for, scene)) if drawn_for == settings => scene.clone(),
            _ => {
                let scene = Arc::new(draw());
                state.scene = Some((settings.clone(), scene.clone()));
                scene
            }
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // The state is plain numbers: valid whatever happened to another holder.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CameraSource for Device {
    fn open(&mut self) -> Result<Box<dyn Camera>, CameraError> {
        Ok(Box::new(self.open_camera()?))
    }

    fn flag(&self) -> Flags {
        Flags::SIMULATED
    }
}

/// Refuses frames that no mask can be for: they would take gigabytes to draw.
fn check_size(settings: &Settings) -> Result<(), CameraError> {
    match u64::from(settings.width) * u64::from(settings.height) {
        0..=MAX_PIXELS => Ok(()),
        _ => Err(CameraError::Refused {
            setting: "width and height",
            asked: format!("{}x{}", settings.width, settings.height),
            applied: format!("at most {MAX_PIXELS} pixels"),
            remedy: "set a smaller width or height".into(),
        }),
    }
}

/// What happens to the frame that is due.
enum Fate {
    Whole,
    Lost,
    Incomplete,
    Frozen,
    Unplugged,
    /// Late, by the library's fault.
    Hung(Duration),
    /// The last of its thread.
    Panicked,
    /// Late, and so many times 2^20 bytes are gone.
    Leaked(u64),
}

impl State {
    fn fate_of_next(&mut self, script: &Simulated) -> Fate {
        let now = Instant::now();
        while let Some(fault) = script.faults.get(self.begun).filter(|fault| fault.at_frame <= self.exposed) {
            self.begun += 1;
            match fault.kind {
                FaultKind::Lost { count } => self.lose += count,
                FaultKind::Incomplete { count } => self.tear += count,
                FaultKind::Freeze { seconds } => {
                    self.frozen_until = Some(now + Duration::from_secs_f64(seconds))
                }
                FaultKind::Unplug { seconds } => {
                    self.unplugged_until = Some(now + Duration::from_secs_f64(seconds));
                    return Fate::Unplugged;
                }
                FaultKind::WrongSettings { count } => {
                    self.misconfigure += count;
                    return Fate::Unplugged;
                }
                FaultKind::Hang { seconds } => return Fate::Hung(Duration::from_secs_f64(seconds)),
                FaultKind::Panic => return Fate::Panicked,
                FaultKind::Leak { megabytes } => return Fate::Leaked(megabytes),
            }
        }
        if self.frozen_until.is_some() {
            return Fate::Frozen;
        }
        self.exposed += 1;
        if self.lose > 0 {
            self.lose -= 1;
            Fate::Lost
        } else if self.tear > 0 {
            self.tear -= 1;
            Fate::Incomplete
        } else {
            Fate::Whole
        }
    }
}

/// An opened simulated camera.
#[derive(Debug)]
struct SimulatedCamera {
    identity: Identity,
    device: Device,
    scene: Option<Arc<Scene>>,
    paced: Paced,
    fps: f64,
}

impl SimulatedCamera {
    fn disconnected(&self, doing: &'static str) -> CameraError {
        CameraError::Disconnected { serial: self.identity.serial.clone(), doing }
    }

    /// A frozen device is silent until its time is over, then goes on.
    fn thaw(&mut self, deadline_ns: u64) -> bool {
        let Some(until) = self.device.state().frozen_until else { return true };
        let left = until.saturating_duration_since(Instant::now());
        if deadline(left) > deadline_ns {
            sleep_until(deadline_ns);
            return false;
        }
        sleep_until(deadline(left));
        self.device.state().frozen_until = None;
        self.paced.resume();
        true
    }
}

impl Camera for SimulatedCamera {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn configure(&mut self, settings: &Settings) -> Result<Applied, CameraError> {
        settings.check_not_binned()?;
        check_size(settings)?;
        settings.check_exposure_fits(self.device.script.readout_us)?;
        // As a sensor does, it knows exposures of whole microseconds and gains of tenths of a decibel.
        let is_wrong = self.device.misconfigures();
        let (exposure_us, gain_db) = (settings.exposure_us.round(), (settings.gain_db * 10.0).round() / 10.0);
        let read_back_us = if is_wrong { 2.0 * exposure_us } else { exposure_us };
        verify("exposure_us", settings.exposure_us, read_back_us, 1.0)?;
        verify("gain_db", settings.gain_db, gain_db.clamp(0.0, 24.0), 0.1)?;
        let still = self.device.script.still;
        let scene = self.device.scene(settings, || Scene::new(settings, exposure_us, gain_db, still));
        self.scene = Some(scene);
        self.fps = settings.fps;
        Ok(Applied { exposure_us, gain_db, ..Applied::exactly(settings) })
    }

    fn queue(&mut self, slot: Slot) -> Result<(), CameraError> {
        self.paced.queue(slot);
        Ok(())
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.paced.start(self.fps);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, CameraError> {
        let deadline_ns = deadline(timeout);
        // Nothing is to be seen before it is configured.
        let Some(scene) = self.scene.clone() else { return Ok(Event::Timeout) };
        loop {
            if !self.thaw(deadline_ns) {
                return Ok(Event::Timeout);
            }
            let Some(due) = self.paced.next(deadline_ns) else { return Ok(Event::Timeout) };
            let fate = self.device.state().fate_of_next(&self.device.script);
            match fate {
                Fate::Whole => {
                    let mut slot = due.slot;
                    scene.render(due.frame_id, slot.pixels_mut());
                    return Ok(Event::Complete(Capture {
                        slot,
                        frame_id: due.frame_id,
                        device_timestamp_ns: Some(due.timestamp_ns),
                        arrival_monotonic_ns: monotonic_ns(),
                    }));
                }
                Fate::Incomplete => {
                    let mut slot = due.slot;
                    let half = slot.len() / 2;
                    scene.render_rows_until(due.frame_id, half, slot.pixels_mut());
                    return Ok(Event::Incomplete(slot));
                }
                Fate::Lost => self.paced.requeue(due.slot),
                Fate::Frozen => self.paced.withdraw(due),
                Fate::Hung(duration) => {
                    self.paced.withdraw(due);
                    std::thread::sleep(duration);
                    self.paced.resume();
                }
                Fate::Leaked(megabytes) => {
                    self.paced.withdraw(due);
                    // Written to, so that it is there. Where there is no more, the runtime aborts, as libraries do.
                    (0..megabytes).for_each(|_| self.device.state().leaked.push(vec![1; 1 << 20]));
                    self.paced.resume();
                }
                Fate::Panicked => std::panic::panic_any("a panic by the camera's script"),
                Fate::Unplugged => return Err(self.disconnected("waiting for a frame")),
            }
        }
    }

    fn temperature_c(&mut self) -> Option<f64> {
        Some(TEMPERATURE_C)
    }

    fn stop(&mut self) {
        self.paced.stop();
    }
}
