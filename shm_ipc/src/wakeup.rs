//! How a consumer waits.

/// How [`Subscriber::wait`](crate::Subscriber::wait) waits for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Wakeup {
    /// Sleeps on the camera's wake word. Costs nothing while it sleeps.
    #[default]
    Futex,
    /// Sleeps until shortly before the next frame is due, then watches for it, for less than 1 % of the frame period on average; then
    /// sleeps as [`Wakeup::Futex`]. For cameras with a steady rate, the shortest wake-up of a consumer that leaves its core to others.
    ///
    /// Watching on the core of the driver's thread would keep the frame from being sent. So the calling thread's affinity is without that
    /// core while it sleeps, and who may use no other core does not watch at all.
    Predictive,
    /// Sleeps on the camera's iceoryx2 event, as a `WaitSet` does that the event is attached to. Slower to wake, and slower for the driver.
    Event,
}
