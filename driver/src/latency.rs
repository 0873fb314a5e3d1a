//! How long frames take, in fixed memory: recorded by one thread without lock or allocation, read by any.
//!
//! A histogram whose buckets are as wide as their values are large: exact up to 63 ns, 32 buckets for each doubling above, so that a
//! quantile is at most 1/32 too high. That is the arrangement of HdrHistogram, whose libraries need either a lock or an allocation to
//! let another thread read.

use std::sync::atomic::{AtomicU64, Ordering};

use uvcam_shm_ipc::health::Latency;

/// Buckets for each doubling, as a power of two.
const PRECISION: u32 = 5;
/// Bits of the largest value that is told apart: 2^36 ns are 69 s. Larger ones are counted as the largest.
const BITS: u32 = 36;
const BUCKETS: usize = ((BITS - PRECISION + 1) as usize) << PRECISION;

/// Durations in ns. Written by one thread: no update can be lost, so `Relaxed` loads and stores suffice. A reader sees each bucket as
/// it is at some moment of the reading.
#[derive(Debug)]
pub struct LatencyHistogram {
    buckets: Box<[AtomicU64]>,
    longest_ns: AtomicU64,
}

impl Default for LatencyHistogram {
    fn default() -> Self {
        LatencyHistogram {
            buckets: (0..BUCKETS).map(|_| AtomicU64::new(0)).collect(),
            longest_ns: AtomicU64::new(0),
        }
    }
}

impl LatencyHistogram {
    /// Counts one duration. To be called by one thread alone.
    pub fn record(&self, duration_ns: u64) {
        if let Some(bucket) = self.buckets.get(bucket_of(duration_ns)) {
            bucket.store(bucket.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        }
        if duration_ns > self.longest_ns.load(Ordering::Relaxed) {
            self.longest_ns.store(duration_ns, Ordering::Relaxed);
        }
    }

    /// What was recorded so far; all zero where nothing was.
    pub fn summary(&self) -> Latency {
        let counts: Vec<u64> = self.buckets.iter().map(|bucket| bucket.load(Ordering::Relaxed)).collect();
        let count = counts.iter().sum();
        let longest_ns = self.longest_ns.load(Ordering::Relaxed);
        let quantile = |share: f64| {
            let rank = (share * count as f64).ceil() as u64;
            let mut seen = 0;
            let bucket = counts.iter().position(|count| {
                seen += count;
                seen >= rank
            });
            bucket.map_or(0, largest_in).min(longest_ns)
        };
        Latency {
            count,
            p50_ns: quantile(0.5),
            p90_ns: quantile(0.9),
            p99_ns: quantile(0.99),
            p999_ns: quantile(0.999),
            max_ns: longest_ns,
        }
    }
}

fn bucket_of(value: u64) -> usize {
    let value = value.min((1 << BITS) - 1);
    let shift = (u64::BITS - value.leading_zeros()).saturating_sub(PRECISION + 1);
    ((shift as usize) << PRECISION) + (value >> shift) as usize
}

fn largest_in(bucket: usize) -> u64 {
    let shift = (bucket >> PRECISION).saturating_sub(1);
    (((bucket - (shift << PRECISION)) as u64 + 1) << shift) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_follow_one_another_without_gap_or_overlap() {
        assert_eq!(bucket_of(0), 0);
        for bucket in 0..BUCKETS - 1 {
            let largest = largest_in(bucket);
            assert_eq!((bucket_of(largest), bucket_of(largest + 1)), (bucket, bucket + 1));
        }
        assert_eq!(bucket_of((1 << BITS) - 1), BUCKETS - 1);
        assert_eq!(bucket_of(u64::MAX), BUCKETS - 1);
    }

    #[test]
    fn quantiles_are_upper_bounds_within_a_thirty_second() {
        let histogram = LatencyHistogram::default();
        // 1 to 10000 us, once each.
        (1..=10_000).for_each(|us| histogram.record(us * 1000));
        let Latency { count, p50_ns, p90_ns, p99_ns, p999_ns, max_ns } = histogram.summary();
        assert_eq!((count, max_ns), (10_000, 10_000_000));
        for (found, true_ns) in
            [(p50_ns, 5_000_000), (p90_ns, 9_000_000), (p99_ns, 9_900_000), (p999_ns, 9_990_000)]
        {
            assert!(true_ns <= found && found <= true_ns + true_ns / 32, "{found} for {true_ns}");
        }
    }

    #[test]
    fn one_long_frame_shows_in_the_maximum_alone() {
        let histogram = LatencyHistogram::default();
        (0..9_999).for_each(|_| histogram.record(50));
        histogram.record(3_000_000_000_000);
        let latency = histogram.summary();
        assert_eq!((latency.p50_ns, latency.p999_ns, latency.max_ns), (50, 50, 3_000_000_000_000));
    }

    #[test]
    fn nothing_recorded_is_all_zero() {
        assert_eq!(LatencyHistogram::default().summary(), Latency::default());
    }
}
