//! Random numbers of a test: others in each run, and the same where a run is to be repeated.

/// Knuth's MMIX generator.
pub struct Dice(u64);

impl Dice {
    /// Begins where the environment variable `UVCAM_TEST_SEED` says, else anywhere, and prints what repeats this run.
    #[allow(clippy::new_without_default, reason = "no two of them are alike")]
    pub fn new() -> Self {
        let seed =
            std::env::var("UVCAM_TEST_SEED").map_or(std::process::id().into(), |seed| seed.parse().unwrap());
        println!("UVCAM_TEST_SEED={seed} repeats this run");
        Dice(seed)
    }

    /// A number below `end`.
    pub fn roll(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // The upper bits are the better ones.
        (self.0 >> 33) % end
    }
}
