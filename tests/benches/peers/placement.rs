//! Which cores the two sides of a chain run on.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// The cores of producers and of consumers; without them, those of this process.
#[derive(Debug, Default)]
pub struct Placement {
    sides: Option<[CpuSet; 2]>,
}

impl Placement {
    /// One half of the cores for producers, the other for consumers.
    pub fn apart() -> Placement {
        let mine = sched_getaffinity(None).unwrap();
        let cores: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|core| mine.is_set(*core)).collect();
        assert!(cores.len() > 1, "--apart needs two cores");
        let (producers, consumers) = cores.split_at(cores.len() / 2);
        Placement { sides: Some([producers, consumers].map(set)) }
    }

    /// Starts a producer.
    pub fn of_producer<T>(&self, start: impl FnOnce() -> T) -> T {
        self.on(0, start)
    }

    /// Starts a consumer.
    pub fn of_consumer<T>(&self, start: impl FnOnce() -> T) -> T {
        self.on(1, start)
    }

    /// A process begins on the cores of the thread that starts it.
    fn on<T>(&self, side: usize, start: impl FnOnce() -> T) -> T {
        let Some(sides) = &self.sides else { return start() };
        let mine = sched_getaffinity(None).unwrap();
        sched_setaffinity(None, &sides[side]).unwrap();
        let started = start();
        sched_setaffinity(None, &mine).unwrap();
        started
    }
}

fn set(cores: &[usize]) -> CpuSet {
    let mut set = CpuSet::new();
    cores.iter().for_each(|core| set.set(*core));
    set
}
