//! A configuration file, as `uvcam run --config` reads it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use uvcam::config::Config;
use uvcam_fuzz::{MemoryFile, message};

thread_local!(static FILE: MemoryFile = MemoryFile::new());

fuzz_target!(|bytes: &[u8]| {
    FILE.with(|file| {
        let path = file.fill(bytes);
        match Config::load(Some(path)) {
            Ok(config) => promises(&config),
            Err(error) => {
                let message = message(&error);
                let rest = message.strip_prefix(&format!("{}:", path.display()));
                let rest = rest.unwrap_or_else(|| panic!("{message}: does not name the file"));
                if let Ok(text) = std::str::from_utf8(bytes) {
                    names_its_place(rest, text);
                }
            }
        }
    });
});

/// After the file, a refusal of a text tells the line and the key, or that the text is not TOML.
fn names_its_place(refusal: &str, text: &str) {
    let mut parts = refusal.split(": ");
    let line = parts.next().and_then(|line| line.parse().ok());
    let lines = 1 + text.matches('\n').count();
    assert!(line.is_some_and(|line| (1..=lines).contains(&line)), "{refusal}: names no line of {lines}");
    let key = parts.next().unwrap_or_default();
    assert!(!key.is_empty(), "{refusal}: names no key");
    assert!(key != "not TOML" || text.parse::<toml::Table>().is_err(), "{refusal}: it is TOML");
}

/// What the rest of the driver takes for granted.
fn promises(config: &Config) {
    assert!(!config.cameras.is_empty());
    assert!((4..=256).contains(&config.ipc.loans()));
    for (place, camera) in config.cameras.iter().enumerate() {
        assert!(config.cameras.iter().skip(place + 1).all(|other| other.name != camera.name));
        assert!(uvcam_shm_ipc::frame_service_name(&camera.name).is_ascii());
        assert!((1..=2 * 16384 * 16384).contains(&camera.settings.frame_bytes()));
        for microseconds in [camera.settings.exposure_us, camera.generate.exposure_us] {
            assert!((1.0..=1e7).contains(&microseconds));
        }
        assert!(camera.settings.fps >= 0.1 && camera.settings.gain_db.is_finite());
        assert_eq!(camera.generate.parameters.check(), Ok(()));
    }
}
