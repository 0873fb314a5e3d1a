//! Whether CONTRACT.md says what lies in memory: a program that knows nothing but its tables writes and reads our records.

use std::fmt::Display;
use std::io::Write;
use std::mem::size_of;
use std::process::{Command, Stdio};
use std::slice;

use crate::header::FrameHeader;
use crate::health::{Health, Latency};
use crate::mask::MaskHeader;
use crate::production::Production;
use crate::wake_word::WakeWord;

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");

/// Runs `contract.py` on the table below a heading.
fn python(heading: &str, job: &str, input: &[u8]) -> Vec<u8> {
    let mut child = Command::new("python3")
        .arg(format!("{PACKAGE}/tests/contract.py"))
        .arg(format!("{PACKAGE}/CONTRACT.md"))
        .args([heading, job])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{heading}: {job}");
    output.stdout
}

/// Numbers as text.
fn numbers<T: Display>(numbers: &[T]) -> String {
    numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// The fields of a record as lines of text, in their order.
macro_rules! lines {
    ($record:expr; $($field:ident $([$numbers:expr])?),+ $(,)?) => {{
        let lines = [$((stringify!($field), lines!(@ $record.$field $(, $numbers)?))),+];
        lines.map(|(name, numbers)| format!("{name} {numbers}\n")).concat()
    }};
    (@ $field:expr) => { numbers(&[$field]) };
    (@ $field:expr, $numbers:expr) => { numbers(&$numbers($field)) };
}

/// A record of which each byte is another number than those around it.
fn record<T: Copy>() -> T {
    let bytes: Vec<u8> = (0..size_of::<T>()).map(|place| (place % 120) as u8 + 1).collect();
    // SAFETY: as many bytes as the record has, and any bytes are a valid record of the contract.
    unsafe { bytes.as_ptr().cast::<T>().read_unaligned() }
}

fn bytes<T: Copy>(record: &T) -> &[u8] {
    // SAFETY: records of the contract have no padding, and this one is borrowed for as long.
    unsafe { slice::from_raw_parts(std::ptr::from_ref(record).cast(), size_of::<T>()) }
}

/// Compares a record with its table, in both directions. A field that is missing, too long, or elsewhere has other bytes.
fn check(heading: &str, record: &[u8], lines: &str) {
    let told = String::from_utf8(python(heading, "read", record)).unwrap();
    assert_eq!(told, lines, "{heading}: what was read");
    assert_eq!(python(heading, "write", lines.as_bytes()), record, "{heading}: what was written");
}

fn same<T>(value: T) -> T {
    value
}

/// As Python writes a number with a point.
fn float(value: f64) -> [String; 1] {
    [format!("{value:?}")]
}

#[test]
fn the_header_of_a_frame() {
    let mut header: FrameHeader = record();
    (header.exposure_us, header.gain_db) = (1000.5, -3.0);
    let lines = lines! { header;
        magic, contract_version, header_size, width, height, stride, pixel_format,
        flags[|flags: crate::Flags| [flags.bits()]], reserved_picture, mask_id[same], exposure_us[float], gain_db[float],
        epoch, sequence, device_frame_id, counting, produced, reserved_order[same],
        frame_period_ns, device_timestamp_ns, arrival_monotonic_ns, send_monotonic_ns, mid_exposure_monotonic_ns,
        mid_exposure_realtime_ns, mid_exposure_uncertainty_ns, reserved_time,
    };
    check("Frame", bytes(&header), &lines);
}

#[test]
fn a_mask() {
    let header: MaskHeader = record();
    let lines = lines! { header;
        magic, contract_version, header_size, width, height, mask_id[same], masked_px, runs, provenance_bytes, reserved[same],
    };
    check("Mask", bytes(&header), &lines);
}

#[test]
fn a_health_record() {
    let mut health: Health = record();
    (health.frame_rate, health.temperature_c) = (59.75, -0.5);
    let latency = |it: Latency| [it.count, it.p50_ns, it.p90_ns, it.p99_ns, it.p999_ns, it.max_ns];
    let lines = lines! { health;
        magic, contract_version, record_size, state, cause, written_monotonic_ns, state_since_monotonic_ns,
        started_monotonic_ns, process_id, mask_mode, frame_rate[float], temperature_c[float],
        published, lost, incomplete, no_free_slot, epochs, failures, resident_bytes, cpu_ns,
        mask_id[same], config_digest[same], reserved_identity[same],
        arrival_to_masked[latency], masked_to_sent[latency], last_error[same],
    };
    check("Health", bytes(&health), &lines);
}

#[test]
fn the_page_of_the_wake_word() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page");
    let word = WakeWord::create(&path).unwrap();
    word.announce();
    word.keep(&Production { counting: 11, produced: 22, epoch: 33 });
    let told = String::from_utf8(python("Wake word", "read", &std::fs::read(&path).unwrap())).unwrap();
    let told: Vec<&str> = told.lines().filter(|line| !line.starts_with("core ")).collect();
    let magic = format!("magic {}", u32::from_le_bytes(*b"UVCW"));
    let frames = format!("word {}", word.frames());
    assert_eq!(told, [&magic, "contract_version 2", &frames, "counting 11", "produced 22", "epoch 33"]);
    assert!(word.frames() > 0);
}
