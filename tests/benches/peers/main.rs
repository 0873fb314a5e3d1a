//! The driver beside what people use today: same frames, same mask, same machine, one run.
//!
//! A chain is a producer and a consumer, in a process each; `programs` holds all of them but the driver. Every round runs every chain
//! once in every scene, so that a change of the machine's mood meets all of them; what counts is the median over the rounds, and ratios
//! within one run. Ends in tables and `bench/results.json`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Parser;

mod chain;
mod measure;
mod placement;
mod report;
mod requirements;
mod results;
mod scene;
mod toolbox;

use chain::Chain;
use placement::Placement;
use results::Results;
use scene::Scene;
use toolbox::Toolbox;

/// Compare the driver with other ways to carry and mask frames.
#[derive(Debug, Parser)]
struct Options {
    /// How often everything is measured; medians count
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// How long each chain is measured in each round, after a second of warming up
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Only these chains
    #[arg(long, value_delimiter = ',', value_enum)]
    only: Vec<Chain>,
    /// Sizes of the frames, px
    #[arg(long, value_delimiter = ',', value_name = "WxH", default_value = "752x480,960x600,1920x1200",
          value_parser = scene::size)]
    sizes: Vec<(u32, u32)>,
    /// Numbers of cameras
    #[arg(long, value_delimiter = ',', value_name = "N", default_value = "1,3")]
    cameras: Vec<usize>,
    /// Leave out the growth with the number of cameras and with the size of the frames
    #[arg(long)]
    no_growth: bool,
    /// Run all chains at real-time priority, above what else the machine does; the kernel stops who spins for 50 ms of each second
    #[arg(long)]
    realtime: bool,
    /// Give producer and consumer a half of the cores each; left alone, a scheduler tends to put both on one
    #[arg(long)]
    apart: bool,
    /// Where the results go
    #[arg(long, value_name = "FILE", default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../bench/results.json"))]
    out: PathBuf,
    /// What cargo says to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let options = Options::parse();
    let mut results = Results::new(options.rounds, options.seconds, options.realtime, options.apart);
    let toolbox = Toolbox::new();
    let placement = if options.apart { Placement::apart() } else { Placement::default() };
    let mut chains = if options.only.is_empty() { Chain::all() } else { options.only.clone() };
    chains.retain(|chain| match toolbox.lacks(*chain) {
        None => true,
        Some(reason) => {
            eprintln!("{} is skipped: {reason}", chain.name());
            results.skipped.push(format!("{}: {reason}", chain.name()));
            false
        }
    });
    let plan = plan(&options, &chains);
    if options.realtime {
        take_realtime_priority();
    }
    for round in 0..options.rounds {
        for (scene, chains) in &plan {
            // Each round begins with another chain: none always follows the same one.
            let first = round as usize % chains.len().max(1);
            for chain in chains.iter().cycle().skip(first).take(chains.len()) {
                let name = chain.name();
                match measure::run(*chain, scene, &toolbox, &placement, options.seconds) {
                    Ok(sample) => {
                        eprintln!("round {}, {scene}, {name:<21} {sample}", round + 1);
                        results.add(*chain, scene, sample);
                    }
                    Err(error) => {
                        eprintln!("round {}, {scene}, {name:<21} FAILED: {error}", round + 1);
                        results.failed.push(format!("round {}, {scene}, {name}: {error}", round + 1));
                    }
                }
            }
        }
    }
    results.judge();
    print!("{}", report::tables(&results));
    write(&options.out, &results);
}

/// Each scene, and the chains that are measured in it.
fn plan(options: &Options, chains: &[Chain]) -> Vec<(Scene, Vec<Chain>)> {
    let with = |scene, chains: &[Chain]| (scene, chains.to_vec());
    let sizes = options.sizes.iter();
    let shapes = sizes.flat_map(|size| options.cameras.iter().map(|cameras| (*size, *cameras)));
    let mut plan: Vec<_> =
        shapes.map(|(size, cameras)| with(Scene::comparison(size, cameras), chains)).collect();
    if !options.no_growth {
        if chains.contains(&Chain::UvcamEvent) {
            plan.extend(Scene::more_cameras().into_iter().map(|scene| with(scene, &[Chain::UvcamEvent])));
        }
        if chains.contains(&Chain::UvcamPoll) {
            plan.extend(Scene::larger_frames().into_iter().map(|scene| with(scene, &[Chain::UvcamPoll])));
        }
    }
    plan
}

/// For this process, and for those that it starts from here on.
fn take_realtime_priority() {
    let id = std::process::id().to_string();
    let chrt = Command::new("chrt").args(["--rr", "--pid", "10", &id]).status();
    assert!(
        chrt.is_ok_and(|status| status.success()),
        "--realtime needs chrt (util-linux) and the right to use it"
    );
}

fn write(file: &Path, results: &Results) {
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(file, serde_json::to_string_pretty(results).unwrap() + "\n").unwrap();
    println!("\nwritten: {}", file.canonicalize().unwrap().display());
}
