//! `uvcam list`: the cameras that can be opened.

use super::table::columns;
use crate::args;
use crate::camera::{Identity, kinds};
use crate::error::Error;
use crate::exit::Exit;

pub(super) fn execute(arguments: &args::List) -> Result<Exit, Error> {
    let cameras = kinds::list();
    if arguments.json {
        // A list of plain texts always has a JSON form.
        super::print(&serde_json::to_string_pretty(&cameras).unwrap_or_default())?;
        return Ok(Exit::Done);
    }
    if cameras.is_empty() {
        tracing::warn!(
            "no camera found; check cables, power, and the rights on the device (udev rules){}",
            without(&kinds::KINDS)
        );
        return Ok(Exit::Done);
    }
    super::print(&table(&cameras))?;
    Ok(Exit::Done)
}

/// What could not be found.
fn without(kinds: &[(&str, bool)]) -> String {
    let missing: Vec<&str> =
        kinds.iter().filter(|(_, is_built_in)| !is_built_in).map(|(kind, _)| *kind).collect();
    match missing.is_empty() {
        true => String::new(),
        false => format!("; this uvcam was built without {}", missing.join(" and ")),
    }
}

fn table(cameras: &[Identity]) -> String {
    let mut rows = vec![["KIND", "SERIAL", "MODEL", "VENDOR", "TRANSPORT", "ADDRESS"].map(String::from)];
    rows.extend(cameras.iter().map(|camera| {
        let Identity { kind, serial, model, vendor, transport, address } = camera.clone();
        [kind.into(), serial, model, vendor, transport, address]
    }));
    columns(&rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_that_are_not_built_in_are_told() {
        assert_eq!(without(&[("aravis", true), ("v4l2", true)]), "");
        let without = without(&[("aravis", false), ("replay", true), ("v4l2", false)]);
        assert_eq!(without, "; this uvcam was built without aravis and v4l2");
    }
}
