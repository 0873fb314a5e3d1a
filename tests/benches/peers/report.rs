//! The results as text.

use std::fmt::Write;

use crate::chain::Chain;
use crate::requirements::Bound;
use crate::results::{Measured, Results};
use crate::scene::Purpose;

/// All tables.
pub fn tables(results: &Results) -> String {
    let mut text = String::new();
    let mut scene = None;
    for measured in &results.chains {
        let this = (measured.purpose, measured.width, measured.height, measured.cameras);
        if scene != Some(this)
            && (measured.purpose == Purpose::Comparison || scene.map(|scene| scene.0) != Some(this.0))
        {
            heading(&mut text, measured);
        }
        scene = Some(this);
        row(&mut text, results, measured);
    }
    let _ = writeln!(text, "\n{:<86} {:>9} {:>12}", "what must hold", "measured", "bound");
    for requirement in &results.requirements {
        let bound = match requirement.bound {
            Bound::AtMost(limit) => format!("<= {limit:.1}"),
            Bound::AtLeast(limit) => format!(">= {limit:.1}"),
        };
        let met = if requirement.met { "met" } else { "NOT MET" };
        let _ = writeln!(text, "{:<86} {:>9.2} {bound:>12}  {met}", requirement.what, requirement.measured);
    }
    let skipped = results.skipped.iter().map(|line| format!("skipped: {line}\n"));
    text.extend(skipped);
    text.extend(results.failed.iter().map(|line| format!("FAILED: {line}\n")));
    let others = results.others_cores();
    let _ = writeln!(text, "\nEverything else on the machine took {others:.2} cores meanwhile.");
    text
}

fn heading(text: &mut String, measured: &Measured) {
    let Measured { width, height, cameras, masked_px, .. } = measured;
    let what = match measured.purpose {
        Purpose::Comparison => format!("{width}x{height}, cameras: {cameras}"),
        Purpose::MoreCameras => format!("{width}x{height}, more cameras"),
        Purpose::LargerFrames => "larger frames, the same area masked".to_owned(),
    };
    let _ = writeln!(
        text,
        "\n{what:<36}|{:^26}|{:^9}|{:^38}|{:^6}|{:^15}",
        "latency, us", "to send,", "processor time, s/1000 frames", "", "uvcam event = 1"
    );
    let _ = writeln!(
        text,
        "{:<36}|{:>8} {:>8} {:>8}|{:^9}|{:>9} {:>9} {:>8} {:>9}|{:>6}|{:>7} {:>7}",
        format!("({masked_px} px masked)"),
        "p50",
        "p99",
        "max",
        "p50, us",
        "producer",
        "consumer",
        "both",
        "- camera",
        "lost",
        "p50",
        "both"
    );
}

fn row(text: &mut String, results: &Results, measured: &Measured) {
    let Measured { purpose, width, height, cameras, ref median, .. } = *measured;
    let name = match purpose {
        Purpose::Comparison => measured.chain.name().to_owned(),
        Purpose::MoreCameras => format!("{}, cameras: {cameras}", measured.chain.name()),
        Purpose::LargerFrames => format!("{}, {width}x{height}", measured.chain.name()),
    };
    let beside = |chain| match purpose {
        Purpose::Comparison => results.median(chain, purpose, (width, height), cameras),
        Purpose::MoreCameras | Purpose::LargerFrames => None,
    };
    let event = beside(Chain::UvcamEvent);
    let ratio =
        |own: Option<f64>, event: Option<f64>| number(own.zip(event).map(|(own, event)| own / event), 2);
    let latency = median.latency_us;
    let _ = writeln!(
        text,
        "{name:<36}|{:>8} {:>8} {:>8}|{:^9}|{:>9.3} {:>9.3} {:>8.3} {:>9}|{:>6}|{:>7} {:>7}",
        number(latency.p50, 1),
        number(latency.p99, 1),
        number(latency.max, 1),
        number(median.ready_to_send_us.and_then(|quantiles| quantiles.p50), 1),
        median.producer_cpu_s,
        median.consumer_cpu_s,
        median.cpu_s(),
        number(beside(Chain::Alone).map(|camera| median.cpu_s() - camera.cpu_s()), 3),
        median.lost,
        ratio(latency.p50, event.and_then(|event| event.latency_us.p50)),
        ratio(Some(median.cpu_s()), event.map(|event| event.cpu_s())),
    );
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}
