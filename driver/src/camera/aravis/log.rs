//! What the library, and those below it, have to say.

use aravis::glib::{LogField, LogLevel, LogWriterOutput, log_set_writer_func};

/// Sends it to the log, for the whole process. To be called once.
pub(in crate::camera) fn log_library() {
    log_set_writer_func(|level, fields| {
        let message = fields.iter().find(|field| field.key() == "MESSAGE").and_then(LogField::value_str);
        match level {
            LogLevel::Error | LogLevel::Critical | LogLevel::Warning => {
                tracing::warn!("{}", message.unwrap_or_default());
            }
            _ => tracing::debug!("{}", message.unwrap_or_default()),
        }
        LogWriterOutput::Handled
    });
}
