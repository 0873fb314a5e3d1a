//! What iceoryx2 says of itself beside its errors. It writes to stderr and waits until that is read; a program that must not wait takes
//! the texts instead.

use std::fmt::Arguments;
use std::sync::{Once, OnceLock};

use iceoryx2::prelude::{LogLevel, set_log_level_from_env_or, set_logger};
use iceoryx2_log::Log;

static SINK: OnceLock<Sink> = OnceLock::new();

struct Sink(fn(&str));

impl Log for Sink {
    fn log(&self, _: LogLevel, origin: Arguments<'_>, text: Arguments<'_>) {
        (self.0)(&format!("iceoryx2: {text} ({origin})"));
    }
}

/// Hands over to `say` what iceoryx2 would write to stderr. To be called before anything else of this library; the first call counts.
pub fn log_to(say: fn(&str)) {
    set_logger(SINK.get_or_init(|| Sink(say)));
}

/// iceoryx2 reports every failed attempt; here, what matters comes back as an error. What it writes to stderr by itself panics where that
/// is closed, so it writes nothing unless somebody takes the texts. `IOX2_LOG_LEVEL` brings it back.
pub(crate) fn quieten() {
    static ONCE: Once = Once::new();
    let level = if SINK.get().is_some() { LogLevel::Error } else { LogLevel::Fatal };
    ONCE.call_once(|| set_log_level_from_env_or(level));
}
