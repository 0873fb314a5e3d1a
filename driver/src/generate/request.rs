//! A request that can be fulfilled: what a command sends, completed by the configuration and checked.

use thiserror::Error;
use uvcam_masker::generate::{IgnoredRegion, Method, ParameterError, Parameters, RectangleError};
use uvcam_shm_ipc::control::{self, EXPOSURE_US, FRAMES, GAIN_DB, GenerateRequest};

use crate::camera::Settings;
use crate::config;

/// The lamp has to move between frames: more of them a second show the same.
const FPS: f64 = 10.0;

/// How a mask is generated; every value within its bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    exposure_us: f64,
    gain_db: f64,
    pub(super) method: Method,
    pub(super) most_frames: u32,
    pub(super) ignored: IgnoredRegion,
    pub(super) parameters: Parameters,
    pub(super) replace: bool,
    pub(super) accept: bool,
}

/// Why a request cannot be fulfilled.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RequestError {
    /// No exposure time of a camera.
    #[error("exposure_us = {exposure_us} refused: ask for {EXPOSURE_US}")]
    ExposureUs {
        /// The value given, microseconds.
        exposure_us: f64,
    },
    /// No gain of a camera.
    #[error("gain_db = {gain_db} refused: ask for {GAIN_DB}")]
    GainDb {
        /// The value given, decibels.
        gain_db: f64,
    },
    /// No frames, or more than can be counted.
    #[error("frames = {frames} refused: ask for {FRAMES}")]
    Frames {
        /// The value given.
        frames: u32,
    },
    /// What is to be ignored is no rectangle.
    #[error("ignore: {0}")]
    Ignore(#[from] RectangleError),
    /// A parameter of the method is out of its range.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

/// What the request leaves open is as configured; what it ignores is ignored besides.
impl TryFrom<(&GenerateRequest, &config::Generate)> for Request {
    type Error = RequestError;

    fn try_from((asked, configured): (&GenerateRequest, &config::Generate)) -> Result<Self, RequestError> {
        let exposure_us = asked.exposure_us.unwrap_or(configured.exposure_us);
        if !EXPOSURE_US.contains(&exposure_us) {
            return Err(RequestError::ExposureUs { exposure_us });
        }
        let gain_db = asked.gain_db.unwrap_or(configured.gain_db);
        if !GAIN_DB.contains(&gain_db) {
            return Err(RequestError::GainDb { gain_db });
        }
        if !FRAMES.contains(&asked.frames) {
            return Err(RequestError::Frames { frames: asked.frames });
        }
        let mut ignored = configured.ignored.clone();
        for rectangle in &asked.ignore {
            ignored.rectangles.push(rectangle.parse()?);
        }
        let defaults = &configured.parameters;
        let parameters = Parameters {
            sigma: asked.sigma.map_or(Ok(defaults.sigma), Parameters::sigma_from)?,
            eta: asked.eta.unwrap_or(defaults.eta),
            leaf: asked.leaf.unwrap_or(defaults.leaf),
            k: asked.k.unwrap_or(defaults.k),
            tau: asked.tau.unwrap_or(defaults.tau),
            kappa: asked.kappa.unwrap_or(defaults.kappa),
        };
        parameters.check()?;
        let (method, most_frames) = match asked.method {
            control::Method::Paper => (Method::Paper, 1),
            control::Method::Fused => (Method::Fused, asked.frames),
        };
        let (replace, accept) = (asked.replace, asked.accept);
        Ok(Request { exposure_us, gain_db, method, most_frames, ignored, parameters, replace, accept })
    }
}

impl Request {
    /// The settings of the flight in the light of this request, at a rate that leaves the exposure room.
    pub fn settings(&self, flight: &Settings) -> Settings {
        let fps = flight.fps.min(FPS).min(0.5e6 / self.exposure_us);
        Settings { exposure_us: self.exposure_us, gain_db: self.gain_db, fps, ..flight.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Generate;
    use crate::error::Error;

    /// What the driver makes of these keys, as a command may send them: not checked by a command line.
    fn request(keys: &str) -> Result<Request, RequestError> {
        let text = format!("{{\"request\":\"generate\"{keys}}}");
        let control::Request::Generate(asked) = text.parse().unwrap() else { panic!("{text}") };
        Request::try_from((&asked, &Generate::default()))
    }

    fn assert_refused(keys: &str, expected: &str) {
        let error = request(keys).unwrap_err();
        assert!(error.to_string().starts_with(expected), "{keys}: {error}");
        assert_eq!(Error::from(error).exit(), crate::exit::Exit::Usage);
    }

    #[test]
    fn light_out_of_range_is_refused_by_its_name() {
        assert!(request(",\"frames\":1").is_ok());
        let wrong = [
            (",\"frames\":8,\"exposure_us\":-5.0", "exposure_us = -5 refused: ask for 1 to 10000000"),
            (",\"frames\":8,\"exposure_us\":1e300", "exposure_us = 1"),
            (",\"frames\":8,\"gain_db\":81", "gain_db = 81 refused: ask for -40 to 80"),
            (",\"frames\":0", "frames = 0 refused: ask for 1 to 255"),
            (",\"frames\":256", "frames = 256 refused"),
        ];
        for (keys, expected) in wrong {
            assert_refused(keys, expected);
        }
        let unknown = GenerateRequest { exposure_us: Some(f64::NAN), ..GenerateRequest::default() };
        assert!(Request::try_from((&unknown, &Generate::default())).is_err());
    }

    #[test]
    fn an_exposure_that_no_camera_has_is_refused_with_its_unit() {
        assert_refused(
            ",\"exposure_us\":0.5",
            "exposure_us = 0.5 refused: ask for 1 to 10000000 microseconds",
        );
    }

    #[test]
    fn a_gain_that_no_camera_has_is_refused_with_its_unit() {
        assert_refused(",\"gain_db\":-41", "gain_db = -41 refused: ask for -40 to 80 decibels");
    }

    #[test]
    fn a_number_of_frames_that_cannot_be_taken_is_refused_by_either_method() {
        for method in ["fused", "paper"] {
            let keys = format!(",\"method\":\"{method}\",\"frames\":0");
            assert_refused(&keys, "frames = 0 refused: ask for 1 to 255 frames");
        }
    }

    #[test]
    fn what_is_no_rectangle_is_refused_as_it_was_written_and_never_at_length() {
        assert_refused(
            ",\"ignore\":[\"::0:240\",\"9:3::\"]",
            "ignore: `9:3::` is no rectangle; give x0:x1:y0:y1",
        );
        let long = format!(",\"ignore\":[\"{}\\u001b[2J\"]", "x".repeat(100_000));
        let said = request(&long).unwrap_err().to_string();
        assert!(said.len() < 250 && !said.contains('\u{1b}'), "{said}");
    }

    #[test]
    fn each_parameter_of_the_method_is_refused_by_its_name() {
        for (keys, expected) in [
            (",\"sigma\":256", "sigma is 256; give 0 to 255"),
            (",\"eta\":1001", "eta is 1001; give 0 to 1000 pixels"),
            (",\"leaf\":7", "leaf is 7; give one of [5, 10, 20, 40]"),
            (",\"k\":0", "k is 0; give 1 to 100 points"),
            (",\"tau\":0", "tau is 0; give a distance in pixels above 0, at most 1000"),
            (",\"kappa\":301", "kappa is 301; give 0 to 300 pixels"),
        ] {
            assert_refused(keys, expected);
        }
    }

    #[test]
    fn what_a_request_leaves_open_is_as_configured_and_what_it_says_comes_first() {
        let configured = Generate {
            exposure_us: 7000.0,
            gain_db: 3.0,
            ignored: IgnoredRegion { rectangles: vec!["::0:240".parse().unwrap()], polygons: vec![] },
            parameters: Parameters { k: 9, kappa: 30, ..Parameters::default() },
        };
        let asked = GenerateRequest {
            gain_db: Some(6.0),
            kappa: Some(40),
            ignore: vec!["376:::".into()],
            ..GenerateRequest::default()
        };
        let request = Request::try_from((&asked, &configured)).unwrap();
        assert_eq!((request.exposure_us, request.gain_db), (7000.0, 6.0));
        assert_eq!(request.parameters, Parameters { k: 9, kappa: 40, ..Parameters::default() });
        let ignored: Vec<String> = request.ignored.rectangles.iter().map(ToString::to_string).collect();
        assert_eq!(ignored, ["0::0:240", "376::0:"]);
        assert_eq!((request.method, request.most_frames), (Method::Fused, 100));
        let one = GenerateRequest { method: control::Method::Paper, ..asked };
        assert_eq!(Request::try_from((&one, &configured)).unwrap().most_frames, 1);
    }
}
