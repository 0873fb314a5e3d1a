//! What is known of GigE Vision without a library that speaks it.

/// How it names itself among the transports.
pub(crate) const GIGE_VISION: &str = "GigEVision";
/// Frames that a socket is to hold while the receiving thread does not run: 130 ms at 60 fps.
pub(crate) const SOCKET_FRAMES: usize = 8;
