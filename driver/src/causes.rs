//! Why something failed, as one text.

/// The error's message followed by those of its causes, where it does not already hold them.
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let message = error.to_string();
        if !text.contains(&message) {
            text = format!("{text}: {message}");
        }
        cause = error.source();
    }
    text
}

/// What a panic left, as text.
pub fn panic_text(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "it left no text".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_of_a_panic_is_found_whatever_it_left() {
        assert_eq!(panic_text(&"text"), "text");
        assert_eq!(panic_text(&String::from("text")), "text");
        assert_eq!(panic_text(&7), "it left no text");
    }
}
