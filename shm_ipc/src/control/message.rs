//! What is said over the control service of a camera. On the wire, each message is one JSON object.
//!
//! ```text
//! {"request":"generate","exposure_us":4000.0}     {"reply":"collecting","progress":{...}}  any number of times
//!                                                 {"reply":"generated","report":{...}}     or "failed"
//! {"request":"reload_mask"}                       {"reply":"done"}                         or "failed"
//! ```

use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What can be requested of a driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "snake_case")]
pub enum Request {
    /// Generate this camera's mask. The replies are [`Reply::Collecting`], and then [`Reply::Generated`] or [`Reply::Failed`].
    Generate(GenerateRequest),
    /// Read this camera's mask anew. The reply is [`Reply::Done`] or [`Reply::Failed`].
    ReloadMask,
}

/// How a mask is to be generated. What is left out is as the driver's configuration says, or as in the default.
///
/// A driver refuses what is out of bounds before it troubles the camera. The bounds of `exposure_us`, `gain_db` and `frames` are
/// [`EXPOSURE_US`](super::EXPOSURE_US), [`GAIN_DB`](super::GAIN_DB) and [`FRAMES`](super::FRAMES); those of the parameters from `sigma` to
/// `kappa` are the method's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GenerateRequest {
    /// How the mask is computed.
    pub method: Method,
    /// Frames that the fused method takes at most.
    pub frames: u32,
    /// Rectangles in pixels that are not the airframe, besides those that are configured: `x0:x1:y0:y1`, columns before rows, the second
    /// ends excluded; an empty end is the image border.
    pub ignore: Vec<String>,
    /// Whether the mask may be very different from the one in force.
    pub replace: bool,
    /// Whether to put the mask in force at once, without a look at the candidate.
    pub accept: bool,
    /// Exposure time of lit frames, microseconds.
    pub exposure_us: Option<f64>,
    /// Gain of lit frames, decibels.
    pub gain_db: Option<f64>,
    /// A pixel brighter than this is a candidate; 8-bit grey value.
    pub sigma: Option<u32>,
    /// The mask needs more candidates than this, pixels.
    pub eta: Option<u32>,
    /// Bucket size of the k-d tree of the published method, points.
    pub leaf: Option<u32>,
    /// Neighbours that the published method connects with each candidate, itself included.
    pub k: Option<u32>,
    /// The published method connects neighbours nearer than this, pixels.
    pub tau: Option<f64>,
    /// Thickness of the drawn contours, pixels; the mask grows by half of it.
    pub kappa: Option<u32>,
}

/// How a mask is computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// From several frames while the lamp moves; ends when the mask has stopped changing.
    #[default]
    Fused,
    /// The published method, from one frame.
    Paper,
}

impl Default for GenerateRequest {
    /// The fused method on at most 100 frames, for a candidate that is like the mask in force.
    fn default() -> Self {
        GenerateRequest {
            method: Method::default(),
            frames: 100,
            ignore: Vec::new(),
            replace: false,
            accept: false,
            exposure_us: None,
            gain_db: None,
            sigma: None,
            eta: None,
            leaf: None,
            k: None,
            tau: None,
            kappa: None,
        }
    }
}

/// What a driver replies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "snake_case")]
pub enum Reply {
    /// Lit frames are being collected, or the mask is being computed from them; more replies are to come.
    Collecting {
        /// How far that is.
        progress: Progress,
    },
    /// A mask was generated, or refused.
    Generated {
        /// What came of it.
        report: Box<GenerateReport>,
    },
    /// It was done.
    Done,
    /// It was not done.
    Failed {
        /// The exit code of a command that fails so.
        exit: u8,
        /// What is wrong, where, and what mends it.
        cause: String,
    },
}

/// How far the collection of lit frames is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// Frames taken.
    pub frames: u32,
    /// Frames that are taken at most.
    pub most_frames: u32,
    /// Pixels found lit so far.
    pub lit_px: u64,
}

/// What came of a request to generate a mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GenerateReport {
    /// Whether there is a mask.
    pub verdict: Verdict,
    /// Why it was refused, and what else is to be known.
    pub findings: Vec<Finding>,
    /// Frames that the mask was made from.
    pub frames_used: u32,
    /// Candidate pixels |P|.
    pub candidates: u64,
    /// The connected parts of the mask.
    pub parts: Vec<Part>,
    /// Time that the computation took, seconds.
    pub seconds: f64,
    /// Identity of the mask, 32 hexadecimal digits.
    pub mask_id: Option<String>,
    /// Overlap with the mask that is in force, 0 to 1.
    pub overlap_with_mask_in_force: Option<f64>,
    /// Where the mask was stored.
    pub file: Option<PathBuf>,
    /// Whether it is in force.
    pub in_force: bool,
}

/// Whether a mask can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// There is a mask.
    Ok,
    /// There is none, as the findings say.
    Refused,
}

/// Something to know about the frames or the mask.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Its name, such as `too_dark`.
    pub name: String,
    /// Whether it refuses the mask.
    pub refuses: bool,
    /// What was found, and what to change.
    pub message: String,
}

/// A connected part of a mask (equation 14 of "Towards Scalable and Fast UAV Deployment").
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Area, px.
    pub area_px: u64,
    /// Length of its outer border, px.
    pub perimeter_px: f64,
    /// Perimeter squared over area.
    pub compactness: f64,
}

/// A text that is no message of this version of the contract.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct UnknownMessage(serde_json::Error);

impl Request {
    /// The text that [`ControlClient::request`](super::ControlClient::request) sends.
    pub fn to_text(&self) -> String {
        json(self)
    }
}

impl Reply {
    /// The text that [`ActiveRequest::reply`](super::ActiveRequest::reply) sends.
    pub fn to_text(&self) -> String {
        json(self)
    }
}

impl FromStr for Request {
    type Err = UnknownMessage;

    fn from_str(text: &str) -> Result<Self, UnknownMessage> {
        serde_json::from_str(text).map_err(UnknownMessage)
    }
}

impl FromStr for Reply {
    type Err = UnknownMessage;

    fn from_str(text: &str) -> Result<Self, UnknownMessage> {
        serde_json::from_str(text).map_err(UnknownMessage)
    }
}

fn json(message: &impl Serialize) -> String {
    // Plain numbers and texts always have a JSON form; a path has one where it is UTF-8, as all of a configuration is.
    serde_json::to_string(message).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_arrive_as_they_were_sent() {
        for number in [3e93, 1000.1, 0.1 + 0.2] {
            let sent = Request::Generate(GenerateRequest { tau: Some(number), ..Default::default() });
            assert_eq!(sent.to_text().parse::<Request>().unwrap(), sent);
        }
    }

    #[test]
    fn what_a_request_leaves_out_is_as_in_the_default() {
        let request: Request = r#"{"request":"generate","method":"paper","gain_db":-1}"#.parse().unwrap();
        let expected =
            GenerateRequest { method: Method::Paper, gain_db: Some(-1.0), ..GenerateRequest::default() };
        assert_eq!(request, Request::Generate(expected));
    }

    #[test]
    fn what_is_no_request_is_refused_with_what_is_wrong() {
        for (text, expected) in [
            ("", "EOF"),
            ("fly", "expected"),
            (r#"{"request":"land"}"#, "unknown variant `land`"),
            (r#"{"request":"generate","exposure_ms":4}"#, "unknown field `exposure_ms`"),
            (r#"{"request":"generate","method":"guess"}"#, "unknown variant `guess`"),
            (r#"{"request":"generate","frames":-1}"#, "invalid value: integer `-1`"),
            (r#"{"request":"generate","exposure_us":1e999}"#, "number out of range"),
        ] {
            let error = text.parse::<Request>().unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn every_reply_arrives_as_it_was_sent() {
        let report = GenerateReport {
            verdict: Verdict::Refused,
            findings: vec![Finding { name: "too_dark".into(), refuses: true, message: "\"dark\"\n".into() }],
            frames_used: 9,
            candidates: 8,
            parts: vec![Part { area_px: 5, perimeter_px: 8.5, compactness: 1.25 }],
            seconds: 0.1 + 0.2,
            mask_id: None,
            overlap_with_mask_in_force: Some(0.5),
            file: Some("/a.png".into()),
            in_force: false,
        };
        for reply in [
            Reply::Collecting { progress: Progress { frames: 3, most_frames: 100, lit_px: 1200 } },
            Reply::Generated { report: Box::new(report) },
            Reply::Done,
            Reply::Failed { exit: 3, cause: "no".into() },
        ] {
            assert_eq!(reply.to_text().parse::<Reply>().unwrap(), reply);
        }
    }
}
