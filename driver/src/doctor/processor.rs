//! Processors and the clock.

use super::machine::Machine;
use super::{Finding, Severity};

const PROCESSORS: &str = "/sys/devices/system/cpu";
const CLOCK: &str = "/sys/devices/system/clocksource/clocksource0";

/// Clock sources that the kernel reads from a device, in well over a microsecond, instead of from a register of the processor.
const SLOW_CLOCKS: [&str; 5] = ["hpet", "acpi_pm", "pit", "jiffies", "refined-jiffies"];

/// What delays a frame under load, and its stamps.
pub(super) fn examine(machine: &Machine) -> Vec<Finding> {
    [governor(machine), clock_source(machine)].concat()
}

/// Whether the processors run at full speed (kernel documentation, CPU performance scaling).
fn governor(machine: &Machine) -> Vec<Finding> {
    let names = machine.names(PROCESSORS);
    let governor = |name: &String| machine.text(&format!("{PROCESSORS}/{name}/cpufreq/scaling_governor"));
    let governors: Vec<String> = names.iter().filter_map(governor).collect();
    let slow: Vec<&String> = governors.iter().filter(|governor| *governor != "performance").collect();
    let Some(first) = slow.first() else { return Vec::new() };
    vec![Finding::new(
        Severity::Warning,
        "cpu_governor",
        format!(
            "{} of {} processors run under the governor \"{first}\", which lowers their speed between two frames",
            slow.len(),
            governors.len()
        ),
        format!("echo performance | sudo tee {PROCESSORS}/cpu*/cpufreq/scaling_governor"),
    )]
}

/// Whether reading the clock, which each frame does several times, needs no device.
fn clock_source(machine: &Machine) -> Vec<Finding> {
    let current = machine.text(&format!("{CLOCK}/current_clocksource")).unwrap_or_default();
    if !SLOW_CLOCKS.contains(&current.as_str()) {
        return Vec::new();
    }
    let available = machine.text(&format!("{CLOCK}/available_clocksource")).unwrap_or_default();
    let better = available.split_whitespace().find(|name| !SLOW_CLOCKS.contains(name));
    let remedy = match better {
        Some(name) => format!("echo {name} | sudo tee {CLOCK}/current_clocksource"),
        None => "see `sudo dmesg | grep -i -e tsc -e clocksource` for why the kernel gave the processor's counter up".into(),
    };
    vec![Finding::new(
        Severity::Warning,
        "clock_source",
        format!("the clock source is \"{current}\", which is slow to read, so stamps are late"),
        remedy,
    )]
}
