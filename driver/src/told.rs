//! Which messages about a camera were told lately. One that fails over and over, in whatever words, does not fill the log.

use std::time::{Duration, Instant};

/// The target of what is the same each time that a camera is opened: the log tells it once, and again at growing distance.
pub(crate) const OPENING: &str = "uvcam::opening";
/// Different messages that may be told within the time of one, where nobody says otherwise.
const KEPT: usize = 8;
/// When a message may be told again: at first, and at the longest. It doubles each time.
const SHORTEST: Duration = Duration::from_secs(60);
const LONGEST: Duration = Duration::from_secs(3600);

/// The messages told lately, and how many were not told.
#[derive(Debug)]
pub(crate) struct Told {
    /// How many different ones there may be.
    kept: usize,
    recent: Vec<Message>,
    untold: u64,
}

impl Default for Told {
    fn default() -> Self {
        Told::keeping(KEPT)
    }
}

#[derive(Debug)]
struct Message {
    /// Its text without figures, which change from time to time.
    words: String,
    pause: Duration,
    again: Instant,
}

impl Told {
    /// Nothing told yet. So many different messages may be, within the time of one.
    pub(crate) const fn keeping(kept: usize) -> Self {
        Told { kept, recent: Vec::new(), untold: 0 }
    }

    /// The message, with the number of those that were not told since the last one; nothing where it is not to be told.
    pub(crate) fn due(&mut self, text: &str, now: Instant) -> Option<String> {
        self.is_due(text, now).map(|untold| match untold {
            0 => text.to_owned(),
            _ => format!("{text} (not told since the last one: {untold})"),
        })
    }

    /// Whether to tell this message, and how many were not told since the last one.
    pub(crate) fn is_due(&mut self, text: &str, now: Instant) -> Option<u64> {
        let words: String = text.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        if let Some(message) = self.recent.iter_mut().find(|message| message.words == words) {
            if now < message.again {
                self.untold += 1;
                return None;
            }
            message.pause = (2 * message.pause).min(LONGEST);
            message.again = now + message.pause;
        } else {
            if self.recent.len() >= self.kept {
                let Some(over) = self.recent.iter().position(|message| message.again <= now) else {
                    self.untold += 1;
                    return None;
                };
                self.recent.swap_remove(over);
            }
            self.recent.push(Message { words, pause: SHORTEST, again: now + SHORTEST });
        }
        Some(std::mem::take(&mut self.untold))
    }

    /// Forgets all of them, as the camera works again. Returns how many were not told since the last one.
    pub(crate) fn forget(&mut self) -> u64 {
        self.recent.clear();
        std::mem::take(&mut self.untold)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_in_turn_are_told_once_and_again_at_growing_distance_with_their_number() {
        let (mut told, start) = (Told::default(), Instant::now());
        let mut due = Vec::new();
        for second in 0..1000 {
            let text = if second % 2 == 0 { "found: Fake OTHER" } else { "found: nothing of that name" };
            if let Some(untold) = told.is_due(text, start + Duration::from_secs(second)) {
                due.push((second, untold));
            }
        }
        assert_eq!(
            due,
            [
                (0, 0),
                (1, 0),
                (60, 58),
                (61, 0),
                (180, 118),
                (181, 0),
                (420, 238),
                (421, 0),
                (900, 478),
                (901, 0)
            ]
        );
    }

    #[test]
    fn figures_make_no_news_and_other_words_do() {
        let (mut told, now) = (Told::default(), Instant::now());
        assert_eq!(told.is_due("no whole frame for 1.2 s", now), Some(0));
        assert_eq!(told.is_due("no whole frame for 11.3 s", now), None);
        assert_eq!(
            told.due("disconnected", now).as_deref(),
            Some("disconnected (not told since the last one: 1)")
        );
        assert_eq!(told.forget(), 0);
        assert_eq!(told.is_due("no whole frame for 1.2 s", now), Some(0));
    }

    #[test]
    fn texts_that_never_repeat_are_bounded_as_well() {
        let (mut told, start) = (Told::default(), Instant::now());
        let text = |number: usize| "x".repeat(number);
        let told_in = |told: &mut Told, texts: std::ops::Range<usize>, now| {
            texts.filter(|number| told.is_due(&text(*number), now).is_some()).count()
        };
        assert_eq!(told_in(&mut told, 0..500, start), KEPT);
        assert_eq!(told_in(&mut told, 500..1000, start + SHORTEST), KEPT);
        assert_eq!(told.forget(), 500 - KEPT as u64);
    }
}
