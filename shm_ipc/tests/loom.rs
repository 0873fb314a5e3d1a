//! The protocol of the wake word's page, in every order in which its users can run: also on processors that reorder more than this one.
//!
//! The page and the numbers that it keeps are the library's own files, built over a model of atomics and of the futex. A sleep has no end
//! here but a wake-up, so that a missed one is a deadlock, which the model reports.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::time::Duration;

use loom::sync::Arc;
use loom::thread;
use page::Page;
use production::Production;
use system::{AtomicU32, Ordering};

#[allow(dead_code, reason = "the tests need a part of it")]
#[path = "../src/wake_word/page.rs"]
mod page;
#[allow(dead_code, reason = "the tests need a part of it")]
#[path = "../src/production.rs"]
mod production;

mod header {
    pub use uvcam_shm_ipc::CONTRACT_VERSION;
}

/// As `src/wake_word/system.rs`.
mod system {
    use std::ops::Deref;
    use std::time::Duration;

    pub use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering};
    use loom::sync::{Condvar, Mutex};

    /// futex(2): the comparison and the sleep are one step, as are the wake-ups of all who sleep.
    #[derive(Debug, Default)]
    pub struct Futex {
        number: AtomicU32,
        queue: Mutex<()>,
        woken: Condvar,
    }

    impl Futex {
        pub fn wait(&self, expected: u32, _: Duration) -> bool {
            let queue = self.queue.lock().unwrap();
            // Relaxed: the kernel orders it by the lock of its queue.
            if self.number.load(Ordering::Relaxed) == expected {
                drop(self.woken.wait(queue).unwrap());
            }
            false
        }

        pub fn wake_all(&self) {
            let _queue = self.queue.lock().unwrap();
            self.woken.notify_all();
        }
    }

    impl Deref for Futex {
        type Target = AtomicU32;

        fn deref(&self) -> &AtomicU32 {
            &self.number
        }
    }

    pub fn current_core() -> Option<u32> {
        None
    }
}

/// A page, and frames in a queue beside it.
#[derive(Debug, Default)]
struct Camera {
    page: Page,
    /// Relaxed throughout: only the page orders them.
    sent: AtomicU32,
}

impl Camera {
    /// As a driver has made it.
    fn new() -> Arc<Self> {
        let camera = Arc::new(Camera::default());
        camera.page.take_over();
        camera
    }

    fn send(&self) {
        let sent = self.sent.load(Ordering::Relaxed);
        self.sent.store(sent + 1, Ordering::Relaxed);
        self.page.announce();
    }

    /// A consumer's wait for as many frames.
    fn receive(&self, frames: u32) {
        loop {
            let seen = self.page.frames();
            if self.sent.load(Ordering::Relaxed) >= frames {
                return;
            }
            self.page.sleep(seen, Duration::MAX);
        }
    }
}

/// Tries every order in which three threads can run, but those in which they are interrupted more than twice in the middle of something:
/// there are too many of these.
fn try_with_three_threads(test: impl Fn() + Sync + Send + 'static) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(2);
    model.check(test);
}

fn spawn(camera: &Arc<Camera>, run: impl FnOnce(&Camera) + 'static) -> thread::JoinHandle<()> {
    let camera = camera.clone();
    thread::spawn(move || run(&camera))
}

fn join(threads: impl IntoIterator<Item = thread::JoinHandle<()>>) {
    threads.into_iter().for_each(|thread| thread.join().unwrap());
}

#[test]
fn no_sleeper_misses_a_frame() {
    try_with_three_threads(|| {
        let camera = Camera::new();
        let sleepers = [(); 2].map(|()| spawn(&camera, |camera| camera.receive(1)));
        camera.send();
        join(sleepers);
    });
}

#[test]
fn a_sleeper_gets_one_frame_after_the_other() {
    loom::model(|| {
        let camera = Camera::new();
        let sleeper = spawn(&camera, |camera| (1..=2).for_each(|frames| camera.receive(frames)));
        (0..2).for_each(|_| camera.send());
        join([sleeper]);
    });
}

#[test]
fn a_consumer_killed_before_it_sleeps_takes_no_wake_up_from_another() {
    try_with_three_threads(|| {
        let camera = Camera::new();
        let killed = spawn(&camera, |camera| {
            let seen = camera.page.frames();
            camera.page.say_asleep(seen);
        });
        let sleeper = spawn(&camera, |camera| camera.receive(1));
        camera.send();
        join([killed, sleeper]);
    });
}

#[test]
fn sleepers_of_a_driver_killed_before_it_wakes_them_are_woken_by_its_successor() {
    try_with_three_threads(|| {
        let camera = Camera::new();
        let sleepers = [(); 2].map(|()| spawn(&camera, |camera| camera.receive(1)));
        // Sent and counted, and not one step further.
        camera.sent.store(1, Ordering::Relaxed);
        camera.page.count_frame();
        camera.page.take_over();
        join(sleepers);
    });
}

#[test]
fn sleepers_of_a_driver_killed_before_it_counts_a_frame_get_that_of_its_successor() {
    loom::model(|| {
        let camera = Camera::new();
        let sleeper = spawn(&camera, |camera| camera.receive(2));
        camera.sent.store(1, Ordering::Relaxed);
        camera.page.take_over();
        camera.send();
        join([sleeper]);
    });
}

#[test]
fn who_finds_a_page_finished_sees_all_of_it() {
    loom::model(|| {
        let camera = Arc::new(Camera::default());
        let consumer = spawn(&camera, |camera| {
            // Acquire, as in `Page::is_ours`.
            if camera.page.identity.magic.load(Ordering::Acquire) == page::MAGIC {
                assert!(camera.page.is_ours());
                camera.receive(1);
            }
        });
        camera.page.take_over();
        camera.send();
        join([consumer]);
    });
}

#[test]
fn what_a_page_keeps_is_whole_wherever_its_driver_is_killed() {
    const FIRST: Production = Production { counting: 7, produced: 0, epoch: 9 };
    loom::model(|| {
        let camera = Camera::new();
        // At any point of it, the successor looks.
        let driver = spawn(&camera, |camera| {
            camera.page.keep(&FIRST);
            camera.page.keep(&FIRST.after(1));
        });
        if let Some(kept) = camera.page.kept() {
            assert!([0, 1].map(|frames| FIRST.after(frames)).contains(&kept), "{kept:?}");
        }
        join([driver]);
        assert_eq!(camera.page.kept(), Some(FIRST.after(1)));
    });
}

#[test]
fn a_frame_that_was_announced_is_counted() {
    const FIRST: Production = Production { counting: 7, produced: 0, epoch: 9 };
    loom::model(|| {
        let camera = Camera::new();
        let begin = camera.page.frames();
        // As `Publisher::publish`: kept, then sent.
        let driver = spawn(&camera, |camera| {
            (1..=2).for_each(|frames| {
                camera.page.keep(&FIRST.after(frames));
                camera.send();
            });
        });
        let announced = u64::from((camera.page.frames() - begin) / 2);
        let kept = camera.page.kept().map_or(0, |kept| kept.produced);
        assert!(kept >= announced, "{announced} announced, {kept} kept");
        join([driver]);
    });
}
