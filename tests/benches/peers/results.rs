//! Everything that was measured, as it is written to the file.

use serde::Serialize;

use crate::chain::Chain;
use crate::measure::{Quantiles, Sample};
use crate::requirements::{Requirement, requirements};
use crate::scene::{Purpose, Scene};

/// One run of the bench.
#[derive(Serialize)]
pub struct Results {
    machine: String,
    cores: usize,
    rounds: u32,
    seconds: f64,
    realtime: bool,
    apart: bool,
    /// Chains that this machine cannot run, and why.
    pub skipped: Vec<String>,
    /// Runs that gave no figures, and why.
    pub failed: Vec<String>,
    /// What must hold, and what was found.
    pub requirements: Vec<Requirement>,
    /// Each chain in each scene.
    pub chains: Vec<Measured>,
}

/// A chain in a scene.
#[derive(Serialize)]
pub struct Measured {
    /// Which.
    pub chain: Chain,
    /// What the scene is for.
    pub purpose: Purpose,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How many cameras there are.
    pub cameras: usize,
    /// Of each frame.
    pub masked_px: u64,
    runs: usize,
    /// The median of every figure over the rounds; of frames and losses, the sum.
    pub median: Sample,
    /// Each round.
    pub rounds: Vec<Sample>,
}

impl Results {
    /// Nothing yet.
    pub fn new(rounds: u32, seconds: f64, realtime: bool, apart: bool) -> Results {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = cpuinfo.lines().find(|line| line.starts_with("model name"));
        let machine =
            model.and_then(|line| line.split_once(": ")).map_or("unknown", |(_, model)| model).to_owned();
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Results {
            machine,
            cores,
            rounds,
            seconds,
            realtime,
            apart,
            skipped: vec![],
            failed: vec![],
            requirements: vec![],
            chains: vec![],
        }
    }

    /// Adds a round.
    pub fn add(&mut self, chain: Chain, scene: &Scene, sample: Sample) {
        let Scene { purpose, width, height, cameras, ref mask, .. } = *scene;
        if let Some(measured) =
            self.chains.iter_mut().find(|measured| measured.is(chain, purpose, (width, height), cameras))
        {
            measured.rounds.push(sample);
            measured.median = median(&measured.rounds);
            return;
        }
        let (masked_px, runs) = (mask.masked_px(), mask.runs().len());
        let (median, rounds) = (sample.clone(), vec![sample]);
        self.chains.push(Measured {
            chain,
            purpose,
            width,
            height,
            cameras,
            masked_px,
            runs,
            median,
            rounds,
        });
    }

    /// Holds the medians against what must hold.
    pub fn judge(&mut self) {
        self.requirements = requirements(self);
    }

    /// The medians of a chain.
    pub fn median(
        &self,
        chain: Chain,
        purpose: Purpose,
        size: (u32, u32),
        cameras: usize,
    ) -> Option<&Sample> {
        let mut chains = self.chains.iter();
        chains.find(|measured| measured.is(chain, purpose, size, cameras)).map(|measured| &measured.median)
    }

    /// Cores that everything else on the machine took, averaged over all runs.
    pub fn others_cores(&self) -> f64 {
        let others =
            || self.chains.iter().flat_map(|measured| &measured.rounds).map(|sample| sample.others_cores);
        others().sum::<f64>() / others().count().max(1) as f64
    }
}

impl Measured {
    fn is(&self, chain: Chain, purpose: Purpose, size: (u32, u32), cameras: usize) -> bool {
        (self.chain, self.purpose, self.width, self.height, self.cameras)
            == (chain, purpose, size.0, size.1, cameras)
    }
}

fn median(samples: &[Sample]) -> Sample {
    let of = |figure: fn(&Sample) -> f64| middle(samples.iter().map(figure).collect()).unwrap_or_default();
    Sample {
        frames: samples.iter().map(|sample| sample.frames).sum(),
        lost: samples.iter().map(|sample| sample.lost).sum(),
        latency_us: quantiles(samples.iter().map(|sample| sample.latency_us).collect()),
        ready_to_send_us: samples
            .iter()
            .map(|sample| sample.ready_to_send_us)
            .collect::<Option<_>>()
            .map(quantiles),
        producer_cpu_s: of(|sample| sample.producer_cpu_s),
        consumer_cpu_s: of(|sample| sample.consumer_cpu_s),
        producer_cores: of(|sample| sample.producer_cores),
        consumer_cores: of(|sample| sample.consumer_cores),
        others_cores: of(|sample| sample.others_cores),
    }
}

fn quantiles(rounds: Vec<Quantiles>) -> Quantiles {
    let of = |figure: fn(&Quantiles) -> Option<f64>| middle(rounds.iter().filter_map(figure).collect());
    Quantiles { p50: of(|round| round.p50), p99: of(|round| round.p99), max: of(|round| round.max) }
}

fn middle(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let upper = *values.get(values.len() / 2)?;
    let lower = *values.get((values.len() - 1) / 2)?;
    Some((lower + upper) / 2.0)
}
