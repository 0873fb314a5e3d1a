use super::*;

fn refusal(spoil: impl FnOnce(&mut Health)) -> HealthError {
    let mut health = Health::new();
    assert_eq!(health.validate(), Ok(()));
    spoil(&mut health);
    health.validate().unwrap_err()
}

#[test]
fn every_field_that_a_reader_relies_on_is_checked() {
    assert_eq!(refusal(|health| health.magic = 7), HealthError::Magic(7));
    assert_eq!(refusal(|health| health.contract_version = 9), HealthError::ContractVersion(9));
    assert_eq!(refusal(|health| health.record_size = 8), HealthError::RecordSize(8));
    assert_eq!(refusal(|health| health.state = 0), HealthError::State(0));
    assert_eq!(refusal(|health| health.cause = 10), HealthError::Cause(10));
    assert!(matches!(refusal(|health| health.frame_rate = f64::NAN), HealthError::FrameRate(_)));
    assert!(matches!(refusal(|health| health.frame_rate = -1.0), HealthError::FrameRate(_)));
    assert!(matches!(refusal(|health| health.masked_to_sent.p90_ns = 1), HealthError::Latency(_)));
}

#[test]
fn codes_lead_back_to_their_states_and_causes() {
    for &state in State::ALL {
        assert_eq!(Health { state: state as u32, ..Health::new() }.state(), Ok(state));
    }
    for &cause in Cause::ALL {
        assert_eq!(Health { cause: cause as u32, ..Health::new() }.cause(), Ok(cause));
    }
    assert_eq!((State::ALL.len(), Cause::ALL.len()), (6, 10));
}

#[test]
fn an_error_is_kept_cut_at_a_character_and_replaced_as_a_whole() {
    let mut health = Health::new();
    assert_eq!(health.last_error(), "");
    let long = "x".repeat(255) + "\u{b5}s";
    health.set_last_error(&long);
    assert_eq!(health.last_error(), "x".repeat(255), "the character of two bytes has no room");
    health.set_last_error("camera left failed");
    assert_eq!(health.last_error(), "camera left failed");
    health.last_error = [0xff; 256];
    assert_eq!(health.last_error().chars().count(), 256, "bytes that are not UTF-8 are replaced");
}

#[test]
fn a_device_that_tells_no_temperature_has_none() {
    assert_eq!(Health::new().temperature_c(), None);
    assert_eq!(Health { temperature_c: 41.5, ..Health::new() }.temperature_c(), Some(41.5));
    assert_eq!(Health { temperature_c: f64::INFINITY, ..Health::new() }.temperature_c(), None);
}
