//! Memory that a camera takes is its own process's to pay for.

use super::*;

/// Times that the victim takes all there is.
const LEAKS: u64 = 6;

#[test]
fn a_camera_that_takes_all_memory_ends_its_own_process_each_time_and_comes_back() {
    // It wants 4 GB. What its process may have is little, so that this is no danger to whoever tests; the kernel says no in the same way.
    let leak = ", faults = [{ kind = \"leak\", at_frame = 30, megabytes = 4096 }]";
    let stage = three_cameras_with("process_memory_mb = 256\n", leak);
    let driver = stage.driver();
    let (returns, accounts) = observed(&stage, |seen| {
        let death = |_| {
            let process = process_of(&driver, VICTIM);
            wait_until("a death for want of memory", || process.is_some_and(|id| !lives(id)));
            seen[0].wait_for_return()
        };
        (0..LEAKS).map(death).collect::<Vec<_>>()
    });
    let output = driver.stop();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    println!("first frame so many ms after a death: {returns:?}");
    assert_siblings_lost_nothing(accounts, LEAKS, &said);
    let cause = "left: memory allocation of 1048576 bytes failed";
    let effect = "left: its process has ended (signal: 6 (SIGABRT)), and is started again";
    let (first_cause, first_effect) = (said.find(cause), said.find(effect));
    assert!(first_cause.is_some() && first_cause < first_effect, "{said}");
    // Not each time, however often.
    assert!([cause, effect, "left: streaming"].iter().all(|text| said.matches(text).count() < 4), "{said}");
}

#[test]
fn a_process_that_has_nearly_all_that_it_may_have_says_so_and_flies() {
    let leak = ", faults = [{ kind = \"leak\", at_frame = 30, megabytes = 220 }]";
    let stage = three_cameras_with("process_memory_mb = 256\n", leak);
    let driver = stage.driver();
    let mut victim = stage.subscriber(VICTIM);
    // Looked for once a second.
    while victim.frames() < 150 {
        next_frame(&mut victim);
    }
    let said = stderr(&driver.stop());
    assert_eq!(victim.epochs(), 1, "{said}");
    assert!(said.contains("of the 256 MB that it may") && said.contains("process_memory_mb"), "{said}");
    assert_eq!(said.matches("WARN left: its process has taken").count(), 1, "{said}");
}

#[test]
fn memory_that_a_camera_takes_is_its_own_process_s_to_pay_for() {
    let stage = three_cameras("");
    let driver = stage.driver();
    CAMERAS.iter().for_each(|camera| _ = stage.process_of(camera));
    let score = |id| -> i32 {
        fs::read_to_string(format!("/proc/{id}/oom_score_adj")).unwrap().trim().parse().unwrap()
    };
    let expected = (score(driver.id()) + 100).min(1000);
    let found: Vec<i32> = children(driver.id()).into_iter().map(score).collect();
    assert_eq!(found, [expected; 3]);
}
