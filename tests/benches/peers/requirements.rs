//! What must hold, in ratios within one run, and whether it does.

use serde::Serialize;

use crate::chain::Chain;
use crate::measure::Sample;
use crate::results::Results;
use crate::scene::{LARGE, MOST_CAMERAS, Purpose, SMALL};

/// One line of the specification.
#[derive(Serialize)]
pub struct Requirement {
    /// What is compared.
    pub what: String,
    /// What was found.
    pub measured: f64,
    /// What it is held against.
    pub bound: Bound,
    /// Whether it holds.
    pub met: bool,
}

/// A limit.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// Not above.
    AtMost(f64),
    /// Not below.
    AtLeast(f64),
}

/// Those that can be judged by what was measured.
pub fn requirements(results: &Results) -> Vec<Requirement> {
    let judge = Judge(results);
    let found = [
        judge.floor(SMALL),
        judge.floor(LARGE),
        judge.floor_p99(),
        judge.p50_below(Chain::Ros1, SMALL, 10.0),
        judge.p50_below(Chain::Ros1, LARGE, 40.0),
        judge.cpu_below(Chain::Ros1, SMALL, 10.0),
        judge.p50_below(Chain::Gstreamer, SMALL, 4.0),
        judge.p50_below(Chain::Gstreamer, LARGE, 8.0),
        judge.sent_before_the_plain_way(),
        judge.nodelet_p50(SMALL, 1.2),
        judge.nodelet_p50(LARGE, 1.0),
        judge.nodelet_cpu(SMALL),
        judge.nodelet_cpu(LARGE),
        judge.best_wait(),
        judge.best_wait_cores(),
        judge.more_cameras(),
        judge.larger_frames(),
        judge.lost(),
    ];
    found.into_iter().flatten().collect()
}

struct Judge<'a>(&'a Results);

impl Judge<'_> {
    /// Polling: the transport alone of the small frame, and the mask's own cost. No pixel is copied, so size adds nothing.
    fn floor(&self, size: (u32, u32)) -> Option<Requirement> {
        let transport_us = self.one(Chain::Iceoryx2Poll, SMALL)?.latency_us.p50?;
        let mask_us = self.one(Chain::Alone, size)?.latency_us.p50?;
        let what = format!(
            "{}: uvcam polling, p50 in us; 1.25 x iceoryx2 polling at {} + mask",
            name(size),
            name(SMALL)
        );
        let measured = self.one(Chain::UvcamPoll, size)?.latency_us.p50?;
        Some(judged(what, measured, Bound::AtMost(1.25 * transport_us + mask_us)))
    }

    fn floor_p99(&self) -> Option<Requirement> {
        let transport_us = self.one(Chain::Iceoryx2Poll, SMALL)?.latency_us.p99?;
        let measured = self.one(Chain::UvcamPoll, SMALL)?.latency_us.p99? / transport_us;
        Some(judged(
            format!("{}: p99, uvcam polling / iceoryx2 polling", name(SMALL)),
            measured,
            Bound::AtMost(1.5),
        ))
    }

    /// Woken by event, against another chain.
    fn p50_below(&self, other: Chain, size: (u32, u32), times: f64) -> Option<Requirement> {
        let other_us = self.one(other, size)?.latency_us.p50?;
        let measured = other_us / self.one(Chain::UvcamEvent, size)?.latency_us.p50?;
        let what = format!("{}: p50, {} / uvcam event", name(size), other.name());
        Some(judged(what, measured, Bound::AtLeast(times)))
    }

    fn cpu_below(&self, other: Chain, size: (u32, u32), times: f64) -> Option<Requirement> {
        let measured = self.one(other, size)?.cpu_s() / self.one(Chain::UvcamEvent, size)?.cpu_s();
        let what = format!("{}: processor time, {} / uvcam event", name(size), other.name());
        Some(judged(what, measured, Bound::AtLeast(times)))
    }

    /// The bridge to ROS 1 beside a camera nodelet, each with a consumer in its process.
    fn nodelet_p50(&self, size: (u32, u32), times: f64) -> Option<Requirement> {
        let p50_us = |chain| self.one(chain, size)?.latency_us.p50;
        let measured = p50_us(Chain::UvcamRos1)? / p50_us(Chain::Ros1Shared)?;
        let what = format!("{}: p50, {} / {}", name(size), Chain::UvcamRos1.name(), Chain::Ros1Shared.name());
        Some(judged(what, measured, Bound::AtMost(times)))
    }

    fn nodelet_cpu(&self, size: (u32, u32)) -> Option<Requirement> {
        let cpu_s = |chain| Some(self.one(chain, size)?.cpu_s());
        let measured = cpu_s(Chain::UvcamRos1)? / cpu_s(Chain::Ros1Shared)?;
        let (ours, theirs) = (Chain::UvcamRos1.name(), Chain::Ros1Shared.name());
        let what = format!("{}: processor time, {ours} / {theirs}", name(size));
        Some(judged(what, measured, Bound::AtMost(1.0)))
    }

    fn sent_before_the_plain_way(&self) -> Option<Requirement> {
        let sent_us = |chain| self.one(chain, LARGE)?.ready_to_send_us?.p50;
        let measured = sent_us(Chain::CopyEvent)? / sent_us(Chain::UvcamEvent)?;
        let what = format!("{}: ready to sent, p50, copy and AND / uvcam event", name(LARGE));
        Some(judged(what, measured, Bound::AtLeast(4.0)))
    }

    /// The shortest wake-up of a consumer that sleeps, against iceoryx2's event.
    fn best_wait(&self) -> Option<Requirement> {
        let (best, best_us) = self.best_sleeper()?;
        let measured = best_us / self.one(Chain::UvcamEvent, SMALL)?.latency_us.p50?;
        let what = format!("{}: p50, {} / uvcam event", name(SMALL), best.name());
        Some(judged(what, measured, Bound::AtMost(1.0 / 3.0)))
    }

    fn best_wait_cores(&self) -> Option<Requirement> {
        let (best, _) = self.best_sleeper()?;
        let percent = |chain| Some(100.0 * self.one(chain, SMALL)?.cores());
        let measured = percent(best)? - percent(Chain::UvcamEvent)?;
        let what = format!("{}: % of a core, {} - uvcam event", name(SMALL), best.name());
        Some(judged(what, measured, Bound::AtMost(1.0)))
    }

    fn best_sleeper(&self) -> Option<(Chain, f64)> {
        let sleepers = [Chain::UvcamPredictive, Chain::UvcamFutex].into_iter();
        let with_p50 = sleepers.filter_map(|chain| Some((chain, self.one(chain, SMALL)?.latency_us.p50?)));
        with_p50.min_by(|(_, one), (_, other)| one.total_cmp(other))
    }

    /// The driver's cost per frame with more cameras, against one, until a core is full.
    fn more_cameras(&self) -> Option<Requirement> {
        let with = |cameras| self.0.median(Chain::UvcamEvent, Purpose::MoreCameras, SMALL, cameras);
        let one_s = with(1)?.producer_cpu_s;
        let grown = (2..=MOST_CAMERAS).filter_map(with).filter(|sample| sample.producer_cores < 1.0);
        let measured = grown.map(|sample| sample.producer_cpu_s / one_s).reduce(f64::max)?;
        let what =
            format!("{}: driver's time per frame, most of 2 to {MOST_CAMERAS} cameras / 1", name(SMALL));
        Some(judged(what, measured, Bound::AtMost(1.3)))
    }

    fn larger_frames(&self) -> Option<Requirement> {
        let in_path_us =
            |size| self.0.median(Chain::UvcamPoll, Purpose::LargerFrames, size, 1)?.ready_to_send_us?.p50;
        let measured = in_path_us(LARGE)? / in_path_us(SMALL)?;
        let what = format!("ready to sent, p50, {} / {} under masks of one area", name(LARGE), name(SMALL));
        Some(judged(what, measured, Bound::AtMost(1.5)))
    }

    fn lost(&self) -> Option<Requirement> {
        let ours = self.0.chains.iter().filter(|measured| measured.chain.is_uvcam());
        let lost = ours.map(|measured| measured.median.lost).reduce(u64::saturating_add)?;
        Some(judged(
            "frames that consumers of uvcam lost, all scenes".to_owned(),
            lost as f64,
            Bound::AtMost(0.0),
        ))
    }

    /// One camera among all chains.
    fn one(&self, chain: Chain, size: (u32, u32)) -> Option<&Sample> {
        self.0.median(chain, Purpose::Comparison, size, 1)
    }
}

fn judged(what: String, measured: f64, bound: Bound) -> Requirement {
    let met = match bound {
        Bound::AtMost(limit) => measured <= limit,
        Bound::AtLeast(limit) => measured >= limit,
    };
    Requirement { what, measured, bound, met }
}

fn name((width, height): (u32, u32)) -> String {
    format!("{width}x{height}")
}
