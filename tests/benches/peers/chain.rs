//! What is compared.

use clap::ValueEnum;
use serde::Serialize;

/// A way of frames from a camera to a consumer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Chain {
    /// A camera and the mask, with no transport
    Alone,
    /// The driver; the consumer asks without a pause
    UvcamPoll,
    /// The driver; the consumer sleeps until a frame is due, and watches for it
    UvcamPredictive,
    /// The driver; the consumer sleeps on the wake word
    UvcamFutex,
    /// The driver; the consumer sleeps on iceoryx2's event
    UvcamEvent,
    /// iceoryx2 alone, no mask; the consumer asks without a pause
    Iceoryx2Poll,
    /// iceoryx2 alone, no mask; the consumer sleeps on the event
    Iceoryx2Event,
    /// Copy into the loan, AND of the whole mask; the consumer sleeps on iceoryx2's event
    CopyEvent,
    /// GStreamer, shmsink to shmsrc, masked by the consumer
    Gstreamer,
    /// ROS 1, sensor_msgs/Image over TCP, masked by the consumer
    Ros1,
    /// ROS 1 in one process, which shares sensor_msgs/Image, masked by the consumer
    Ros1Shared,
    /// The driver; its bridge to ROS 1 and the consumer share sensor_msgs/Image in one process
    UvcamRos1,
}

/// A process of a chain.
pub enum Program {
    /// `uvcam run`
    Driver,
    /// A way of the peer in Rust.
    Peer(&'static str),
    /// A way of the peer in C++ of this chain.
    Cpp(&'static str),
}

impl Chain {
    /// All of them, in the order of the tables.
    pub fn all() -> Vec<Chain> {
        Chain::value_variants().to_vec()
    }

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Chain::Alone => "camera and mask alone",
            Chain::UvcamPoll => "uvcam, polling",
            Chain::UvcamPredictive => "uvcam, predictive",
            Chain::UvcamFutex => "uvcam, futex",
            Chain::UvcamEvent => "uvcam, event",
            Chain::Iceoryx2Poll => "iceoryx2, polling",
            Chain::Iceoryx2Event => "iceoryx2, event",
            Chain::CopyEvent => "copy and AND, event",
            Chain::Gstreamer => "GStreamer shm",
            Chain::Ros1 => "ROS 1 TCP",
            Chain::Ros1Shared => "ROS 1 in one process",
            Chain::UvcamRos1 => "uvcam, ROS 1",
        }
    }

    /// Whether it is the driver's.
    pub fn is_uvcam(self) -> bool {
        matches!(self.producer(), Some(Program::Driver))
    }

    /// Who makes the frames. `None`: the consumer does.
    pub fn producer(self) -> Option<Program> {
        match self {
            Chain::Alone | Chain::Ros1Shared => None,
            Chain::UvcamPoll
            | Chain::UvcamPredictive
            | Chain::UvcamFutex
            | Chain::UvcamEvent
            | Chain::UvcamRos1 => Some(Program::Driver),
            Chain::Iceoryx2Poll | Chain::Iceoryx2Event => Some(Program::Peer("iceoryx2-produce")),
            Chain::CopyEvent => Some(Program::Peer("copy-produce")),
            Chain::Gstreamer | Chain::Ros1 => Some(Program::Cpp("produce")),
        }
    }

    /// Who receives and measures them.
    pub fn consumer(self) -> Program {
        match self {
            Chain::Alone => Program::Peer("alone"),
            Chain::UvcamPoll => Program::Peer("uvcam-poll"),
            Chain::UvcamPredictive => Program::Peer("uvcam-predictive"),
            Chain::UvcamFutex => Program::Peer("uvcam-futex"),
            Chain::UvcamEvent => Program::Peer("uvcam-event"),
            Chain::Iceoryx2Poll => Program::Peer("iceoryx2-poll"),
            Chain::Iceoryx2Event => Program::Peer("iceoryx2-event"),
            Chain::CopyEvent => Program::Peer("copy-event"),
            Chain::Gstreamer | Chain::Ros1 | Chain::UvcamRos1 => Program::Cpp("consume"),
            Chain::Ros1Shared => Program::Cpp("share"),
        }
    }
}
