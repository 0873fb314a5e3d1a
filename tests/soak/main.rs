//! What shows after minutes only. `make soak` runs it alone, one test after the other: what a consumer loses on a busy machine tells of that
//! machine.
#![allow(clippy::unwrap_used)]

mod growth;
mod stops_and_deaths;

/// How long each test lets the driver run, seconds.
fn seconds() -> u64 {
    std::env::var("UVCAM_SOAK_S").map_or(60, |text| text.parse().unwrap())
}
