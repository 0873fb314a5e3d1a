//! The keys of each table, and which one was meant.

/// Where no heading has come yet.
pub(super) const TOP: &str = "the top of the file";

/// A heading, or `source`, and its keys as the structures of `document`, `source`, `generate` and `realtime` have them.
pub(super) const TABLES: [(&str, &[&str]); 6] = [
    (TOP, &["ipc", "camera", "uav", "process_per_camera"]),
    ("[ipc]", &["prefix", "root_path", "max_subscribers", "buffer", "borrowed", "slots"]),
    (
        "[[camera]]",
        &[
            "name",
            "source",
            "width",
            "height",
            "offset_x",
            "offset_y",
            "binning_horizontal",
            "binning_vertical",
            "pixel_format",
            "fps",
            "exposure_us",
            "gain_db",
            "mask",
            "mask_mode",
            "generate",
            "realtime",
        ],
    ),
    (
        "source",
        &[
            "kind",
            "serial",
            "path",
            "still",
            "readout_us",
            "faults",
            "memory",
            "gain_step_db",
            "fixed_exposure_us",
        ],
    ),
    (
        "[camera.generate]",
        &[
            "exposure_us",
            "gain_db",
            "camera_place",
            "ignore",
            "ignore_polygons",
            "sigma",
            "eta",
            "leaf",
            "k",
            "tau",
            "kappa",
        ],
    ),
    ("[camera.realtime]", &["priority", "cpus"]),
];

/// Words that other programs use, and ours.
const ALSO_CALLED: [(&str, &str); 20] = [
    ("device", "path"),
    ("dev", "path"),
    ("node", "path"),
    ("file", "path"),
    ("folder", "path"),
    ("directory", "path"),
    ("type", "kind"),
    ("driver", "kind"),
    ("id", "serial"),
    ("address", "serial"),
    ("ip", "serial"),
    ("rate", "fps"),
    ("frame_rate", "fps"),
    ("framerate", "fps"),
    ("format", "pixel_format"),
    ("encoding", "pixel_format"),
    ("uvc", "v4l2"),
    ("gige", "aravis"),
    ("grey", "Mono8"),
    ("y8", "Mono8"),
];

/// The name among `known` that was likely meant by `word`.
pub(super) fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let word = word.to_lowercase();
    let also_called = ALSO_CALLED.iter().find(|(other, _)| *other == word).map(|(_, ours)| *ours);
    if let Some(name) = known.iter().find(|name| also_called == Some(**name)) {
        return Some(name);
    }
    let likeness = |name: &str| strsim::jaro_winkler(&name.to_lowercase(), &word);
    let best = known.iter().max_by(|one, other| likeness(one).total_cmp(&likeness(other)));
    best.copied().filter(|name| likeness(name) > 0.7)
}

/// ` (did you mean "..."?)`, or nothing.
pub(super) fn suggestion(word: &str, known: &[&str]) -> String {
    nearest(word, known).map_or(String::new(), |name| format!(" (did you mean \"{name}\"?)"))
}

/// The table that has the key, besides the one whose keys are `known`.
pub(super) fn home_of(key: &str, known: &[&str]) -> Option<&'static str> {
    let has_it = |(_, keys): &&(&str, &[&str])| *keys != known && keys.contains(&key);
    TABLES.iter().find(has_it).map(|(table, _)| *table)
}

/// The table whose keys are `known`.
pub(super) fn table_of(known: &[&str]) -> Option<&'static str> {
    TABLES.iter().find(|(_, keys)| *keys == known).map(|(table, _)| *table)
}
