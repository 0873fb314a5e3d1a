//! One line that the parser did not understand, and what its writer meant.

use super::error::shortened;

/// A key and its value as they are written, understood or not.
#[derive(Debug)]
pub(super) struct Statement {
    /// The key; where none can be told, the word "line".
    pub(super) key: String,
    /// What is written behind `=`; the whole line where there is none.
    value: String,
    has_value: bool,
    line: String,
}

/// Keys whose values are texts.
const TEXTS: [&str; 11] = [
    "uav",
    "prefix",
    "root_path",
    "name",
    "kind",
    "serial",
    "path",
    "memory",
    "pixel_format",
    "mask",
    "camera_place",
];
/// Quotation marks that are none in TOML.
const OTHER_QUOTES: [char; 9] = ['“', '”', '„', '‟', '‘', '’', '«', '»', '`'];
/// Characters that are taken for a space, or are not seen at all.
const UNSEEN: [char; 7] = ['\u{a0}', '\u{2007}', '\u{202f}', '\u{200b}', '\u{2060}', '\u{feff}', '\u{3000}'];

impl Statement {
    /// The statement around the byte at `offset`.
    pub(super) fn at(text: &str, offset: usize) -> Self {
        let begin = text.get(..offset).and_then(|before| before.rfind('\n')).map_or(0, |end| end + 1);
        let line = text.get(begin..).and_then(|rest| rest.lines().next()).unwrap_or_default();
        let line = before_comment(line);
        let part = trimmed(part_at(line, offset.saturating_sub(begin)));
        // Behind the last brace: the table itself.
        let part = if part.trim_matches(',').is_empty() { trimmed(line) } else { part };
        let line = trimmed(line).to_owned();
        match part.split_once('=') {
            Some((key, value)) if !trimmed(key).is_empty() => {
                let key = trimmed(key).trim_matches(['"', '\'']).to_owned();
                Statement { key, value: trimmed(value).to_owned(), has_value: true, line }
            }
            _ => {
                let word = part.split([':', ' ', '\t']).next().filter(|word| is_key(word));
                let key = if part.starts_with('[') { heading(part) } else { word.unwrap_or("line") };
                Statement { key: key.to_owned(), value: part.to_owned(), has_value: false, line }
            }
        }
    }

    /// The line, for a message.
    pub(super) fn line(&self) -> String {
        shortened(&self.line)
    }

    /// What is written, for a message.
    pub(super) fn found(&self) -> String {
        match self.value.as_str() {
            "" => "nothing".into(),
            value => shortened(value),
        }
    }

    /// What to write instead, where that can be told. `message` is the parser's.
    pub(super) fn remedy(&self, message: &str) -> Option<String> {
        let value = self.value.as_str();
        let of_structure = [
            ("missing comma between key", "write a comma between keys, and } behind the last"),
            (
                "missing comma between array",
                "write a comma between the elements of a list, and ] behind the last",
            ),
            ("unclosed inline table", "write } behind the last key"),
            ("unclosed array,", "write ] behind the last element"),
            ("unexpected `=` in array", "write { } around keys, [ ] around a list"),
            ("carriage return", "save it with the line ends of Unix (LF)"),
        ];
        if let Some((_, write)) = of_structure.iter().find(|(start, _)| message.starts_with(start)) {
            return Some((*write).into());
        }
        if let Some(unseen) = value.chars().chain(self.key.chars()).find(|c| UNSEEN.contains(c)) {
            return Some(format!("write a plain space instead of the character U+{:04X}", u32::from(unseen)));
        }
        if !self.has_value {
            return without_value(value);
        }
        if value.is_empty() {
            return Some("write a value behind =".into());
        }
        if self.key.ends_with(':') {
            let key = trimmed(self.key.trim_end_matches(':'));
            return Some(format!("write = between key and value: {key} = {}", shortened(value)));
        }
        let bare = trimmed(value.trim_end_matches([',', ';']));
        let is_longer = bare.len() < value.len();
        if is_longer && bare.ends_with(['}', ']']) {
            return Some("write nothing behind the last bracket".into());
        }
        if !bare.starts_with(['"', '\'', '/']) && ["//", ";", "/*"].iter().any(|mark| bare.contains(mark)) {
            return Some("write # before a comment".into());
        }
        let has_another = bare.split(['"', '\'']).step_by(2).any(|plain| plain.contains('='));
        if has_another && !bare.starts_with('=') {
            return Some("write one key a line, with one =".into());
        }
        let meant =
            if TEXTS.contains(&self.key.as_str()) { text(bare) } else { number(&self.key, bare, false) };
        meant
            .or_else(|| boolean(bare))
            .or_else(|| is_longer.then(|| format!("write nothing behind it: {bare}")))
    }
}

/// What to write instead of a line without a key and its value.
fn without_value(line: &str) -> Option<String> {
    if line.starts_with('[') {
        return match heading(line) {
            "" => Some("write a name between the brackets".into()),
            "camera" => Some("write [[camera]]".into()),
            heading => Some(format!("write [{heading}]")),
        };
    }
    if ["//", ";", "--", "/*", "%"].iter().any(|mark| line.starts_with(mark)) {
        return Some("write # before a comment".into());
    }
    let (key, value) = line.split_once([':', ' ', '\t'])?;
    let key = key.trim_matches(['"', '\'']);
    let value = value.trim_start_matches([':', ' ', '\t']);
    (is_key(key) && !value.is_empty())
        .then(|| format!("write = between key and value: {key} = {}", shortened(value)))
}

/// Without what TOML takes for a space.
fn trimmed(text: &str) -> &str {
    text.trim_matches([' ', '\t'])
}

fn is_key(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

fn heading(line: &str) -> &str {
    line.trim_matches(['[', ']', ' '])
}

/// What to write instead of a text that is not one.
fn text(value: &str) -> Option<String> {
    if value.starts_with('"') && value.contains('\\') {
        let plain = value.trim_matches('"');
        return Some(format!("write it in single quotes, where \\ is a plain character: '{plain}'"));
    }
    let is_sound =
        |quote| value.matches(quote).count() == 2 && value.starts_with(quote) && value.ends_with(quote);
    if is_sound('"') || is_sound('\'') {
        return None;
    }
    let plain = value.trim_matches(|c| OTHER_QUOTES.contains(&c) || "\"'".contains(c)).trim();
    let quotes = if value.starts_with(OTHER_QUOTES) { "straight quotes" } else { "quotes" };
    (!plain.is_empty()).then(|| format!("write it in {quotes}: \"{}\"", shortened(plain)))
}

/// What to write instead of a number that is not one; `whole` where it must have no fraction.
pub(super) fn number(key: &str, value: &str, whole: bool) -> Option<String> {
    let plain = value.trim_matches(|c: char| OTHER_QUOTES.contains(&c) || "\"' \t".contains(c));
    let unquoted = if plain == value { "" } else { " without quotes" };
    let plain = plain.replace(['−', '–'], "-");
    if plain.eq_ignore_ascii_case("auto") {
        return Some("write a number: all automatics are switched off".into());
    }
    if let Ok(number) = plain.parse::<f64>()
        && plain.contains(char::is_alphabetic)
    {
        // An exponent, infinity or none.
        return (whole && number.is_finite())
            .then(|| format!("write it without an exponent{unquoted}: {number}"));
    }
    let length = plain.find(|c: char| !(c.is_ascii_digit() || "+-.,".contains(c))).unwrap_or(plain.len());
    let (digits, unit) = plain.split_at(length);
    let pointed = digits.trim_end_matches(',').replacen(',', ".", 1);
    let parsed = pointed.parse::<f64>().ok()?;
    if !unit.trim().is_empty() {
        let is_grouped = unit.trim().chars().all(|c| c.is_ascii_digit() || " '_".contains(c));
        return Some(match is_grouped {
            true => format!("write the digits without gaps: {}", plain.replace([' ', '\'', '_'], "")),
            false => format!("write the number alone{unquoted}{}", unit_of(key)),
        });
    }
    if pointed.len() == digits.len() && digits.contains(',') {
        // A thousand in English, and one elsewhere.
        if digits.split(',').next_back().is_some_and(|digits| digits.len() == 3) {
            let thousands = digits.replace(',', "");
            return Some(format!("write a point{unquoted}, {pointed}, or no comma, {thousands}"));
        }
        return Some(format!("write a point{unquoted}: {pointed}"));
    }
    if whole && pointed.contains('.') {
        return Some(match parsed.fract() == 0.0 {
            true => format!("write it without a fraction{unquoted}: {parsed}"),
            false => format!("write it without a fraction{unquoted}"),
        });
    }
    let (sign, unsigned) = pointed.split_at(usize::from(pointed.starts_with(['+', '-'])));
    let leading = unsigned.trim_start_matches('0');
    if unsigned.starts_with('.') || unsigned.ends_with('.') {
        return Some(format!("write digits on both sides of the point{unquoted}: {parsed:?}"));
    }
    if leading.len() < unsigned.len() && leading.starts_with(|c: char| c.is_ascii_digit()) {
        return Some(format!("write it without zeros in front{unquoted}: {sign}{leading}"));
    }
    (pointed != value).then(|| format!("write it{unquoted}: {pointed}"))
}

/// What to write instead of another language's word for true or false.
pub(super) fn boolean(value: &str) -> Option<String> {
    let word = value.trim_matches(['"', '\'']).to_ascii_lowercase();
    match word.as_str() {
        "true" | "yes" | "on" => Some("write true".into()),
        "false" | "no" | "off" => Some("write false".into()),
        _ => None,
    }
}

fn unit_of(key: &str) -> &'static str {
    match key {
        key if key.ends_with("_us") => ", in microseconds",
        key if key.ends_with("_db") => ", in decibels",
        "fps" => ", in frames a second",
        "seconds" => ", in seconds",
        "width" | "height" | "offset_x" | "offset_y" | "tau" | "kappa" => ", in pixels",
        _ => "",
    }
}

/// The line without a comment of TOML.
fn before_comment(line: &str) -> &str {
    let mut quote = None;
    for (offset, character) in line.char_indices() {
        match (quote, character) {
            (None, '#') => return line.get(..offset).unwrap_or(line),
            (None, '"' | '\'') => quote = Some(character),
            (Some(open), close) if open == close => quote = None,
            _ => {}
        }
    }
    line
}

/// The part between braces and commas around `offset`, where the line has an inline table; a comma within a number parts nothing.
fn part_at(line: &str, offset: usize) -> &str {
    let Some(first) = line.find('{').filter(|first| *first < offset) else { return line };
    let bytes = line.as_bytes();
    let digit = |at: Option<usize>| at.and_then(|at| bytes.get(at)).is_some_and(u8::is_ascii_digit);
    let parts = |at: usize| match bytes.get(at) {
        Some(b'{' | b'}') => true,
        Some(b',') => !(digit(at.checked_sub(1)) && digit(Some(at + 1))),
        _ => false,
    };
    let begin = (first..offset).rev().find(|at| parts(*at)).map_or(first, |at| at + 1);
    let end = (begin.max(offset)..bytes.len()).find(|at| parts(*at)).unwrap_or(bytes.len());
    line.get(begin..end).unwrap_or(line)
}
