//! One chain, once.

use std::fmt;
use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde::{Deserialize, Serialize};
use uvcam_tests::{binary, children};

use crate::chain::Chain;
use crate::placement::Placement;
use crate::scene::Scene;
use crate::toolbox::Toolbox;

/// Longest wait for a process to begin, to report or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// What a consumer prints.
#[derive(Debug, Clone, Copy, Deserialize)]
struct Report {
    frames: u64,
    lost: u64,
    latency_us: Quantiles,
    ready_to_send_us: Option<Quantiles>,
}

/// Of a time, microseconds; nothing where no frame came.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Quantiles {
    /// Median.
    pub p50: Option<f64>,
    /// 99 %.
    pub p99: Option<f64>,
    /// Largest.
    pub max: Option<f64>,
}

/// What one run of a chain gave.
#[derive(Debug, Clone, Serialize)]
pub struct Sample {
    /// Frames that the consumer received, of all cameras.
    pub frames: u64,
    /// Frames that it did not.
    pub lost: u64,
    /// From frame ready in the producer to masked frame in the consumer.
    pub latency_us: Quantiles,
    /// From frame ready to handed to the transport, where the producer is ours.
    pub ready_to_send_us: Option<Quantiles>,
    /// Processor time of the producer for 1000 frames, seconds.
    pub producer_cpu_s: f64,
    /// Processor time of the consumer for 1000 frames, seconds.
    pub consumer_cpu_s: f64,
    /// Share of a core that the producer takes.
    pub producer_cores: f64,
    /// Share of a core that the consumer takes.
    pub consumer_cores: f64,
    /// Cores that everything else on the machine took meanwhile: the higher, the less the figures say.
    pub others_cores: f64,
}

impl Sample {
    /// Processor time of both processes for 1000 frames, seconds.
    pub fn cpu_s(&self) -> f64 {
        self.producer_cpu_s + self.consumer_cpu_s
    }

    /// Share of a core that both processes take.
    pub fn cores(&self) -> f64 {
        self.producer_cores + self.consumer_cores
    }
}

impl fmt::Display for Sample {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Quantiles { p50, p99, .. } = self.latency_us;
        let [p50, p99] = [p50, p99].map(|us| us.unwrap_or(f64::NAN));
        let (cpu, lost, others) = (self.cpu_s(), self.lost, self.others_cores);
        write!(
            f,
            "p50 {p50:7.1} us, p99 {p99:7.1} us, {cpu:6.3} s/1000 frames, {lost} lost, others {others:.1} cores"
        )
    }
}

/// Starts a chain, lets it warm up, measures it, and ends it. Where that fails, says why.
pub fn run(
    chain: Chain,
    scene: &Scene,
    toolbox: &Toolbox,
    placement: &Placement,
    seconds: f64,
) -> Result<Sample, String> {
    let start = |program| Running::start(toolbox.command(chain, &program, scene, seconds));
    let producer = chain.producer().map(|program| placement.of_producer(|| start(program)));
    let mut consumer = placement.of_consumer(|| start(chain.consumer()));
    let lines = consumer.lines();
    let line = || {
        let line = lines.recv_timeout(PATIENCE + Duration::from_secs_f64(seconds));
        line.map_err(|_| "the consumer fell silent".to_owned())
    };
    let begin = line()?;
    assert_eq!(begin, "begin");
    let before = Usage::read(producer.as_ref(), &consumer);
    let line = line()?;
    let after = Usage::read(producer.as_ref(), &consumer);
    let report: Report = serde_json::from_str(&line).map_err(|error| format!("{line}: {error}"))?;
    consumer.end();
    producer.into_iter().for_each(Running::end);
    Ok(sample(&report, &before, &after))
}

fn sample(report: &Report, before: &Usage, after: &Usage) -> Sample {
    let span_s = (after.at - before.at).as_secs_f64();
    let [producer, consumer] =
        [(after.producer_ns, before.producer_ns), (after.consumer_ns, before.consumer_ns)]
            .map(|(after, before)| (after - before) as f64 * 1e-9);
    let thousands = report.frames.max(1) as f64 / 1000.0;
    Sample {
        frames: report.frames,
        lost: report.lost,
        latency_us: report.latency_us,
        ready_to_send_us: report.ready_to_send_us,
        producer_cpu_s: producer / thousands,
        consumer_cpu_s: consumer / thousands,
        producer_cores: producer / span_s,
        consumer_cores: consumer / span_s,
        others_cores: ((after.machine_s - before.machine_s - producer - consumer) / span_s).max(0.0),
    }
}

/// Processor time, at one instant.
struct Usage {
    at: Instant,
    producer_ns: u64,
    consumer_ns: u64,
    machine_s: f64,
}

impl Usage {
    fn read(producer: Option<&Running>, consumer: &Running) -> Usage {
        Usage {
            at: Instant::now(),
            producer_ns: producer.map_or(0, Running::cpu_ns),
            consumer_ns: consumer.cpu_ns(),
            machine_s: machine_cpu_s(),
        }
    }
}

/// Processor time of all processes since boot, seconds; proc_pid_stat(5) counts it in hundredths.
fn machine_cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/stat").unwrap();
    let ticks: Vec<f64> =
        stat.lines().next().unwrap().split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
    // user, nice, system, idle, iowait, irq, softirq
    (ticks[0] + ticks[1] + ticks[2] + ticks[5] + ticks[6]) / 100.0
}

/// A process of a chain; killed where the bench ends first.
struct Running {
    child: Child,
    is_driver: bool,
}

impl Running {
    fn start(mut command: Command) -> Running {
        let is_driver = command.get_program() == binary();
        let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        Running { child: child.unwrap_or_else(|error| panic!("{command:?}: {error}")), is_driver }
    }

    /// Lines of its standard output.
    fn lines(&mut self) -> Receiver<String> {
        let (sender, receiver) = channel();
        let output = BufReader::new(self.child.stdout.take().unwrap());
        thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        receiver
    }

    /// Processor time of its living threads and of those of its children: the first number of each `schedstat`, in nanoseconds (proc(5)).
    fn cpu_ns(&self) -> u64 {
        let processes = children(self.child.id()).into_iter().chain([self.child.id()]);
        let threads = processes.flat_map(|id| fs::read_dir(format!("/proc/{id}/task")).into_iter().flatten());
        let read = |thread: fs::DirEntry| fs::read_to_string(thread.path().join("schedstat")).ok();
        let time = |stat: String| stat.split_whitespace().next()?.parse::<u64>().ok();
        threads.filter_map(|thread| read(thread.ok()?).and_then(time)).sum()
    }

    /// Asks it to end, and waits for it: peers hear the end of their input, the driver a signal.
    fn end(mut self) {
        drop(self.child.stdin.take());
        if self.is_driver {
            let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
        }
        let deadline = Instant::now() + PATIENCE;
        while self.child.try_wait().unwrap().is_none() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
