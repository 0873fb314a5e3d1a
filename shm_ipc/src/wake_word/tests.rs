use rustix::thread::sched_getcpu;

use super::page::ASLEEP;
use super::system::{AtomicU32, Ordering};
use super::*;

const LONG: Duration = Duration::from_secs(20);

fn page() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let path = folder.path().join("left.wake");
    (folder, path)
}

#[test]
fn a_frame_before_the_sleep_is_not_missed() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    let consumer = WakeWord::open(&path).unwrap().unwrap();
    let seen = consumer.frames();
    driver.announce();
    assert!(!consumer.sleep(seen, LONG));
    assert_ne!(consumer.frames(), seen);
}

#[test]
fn all_sleepers_wake() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    std::thread::scope(|scope| {
        let sleepers: Vec<_> = (0..6)
            .map(|_| {
                let consumer = WakeWord::open(&path).unwrap().unwrap();
                let seen = consumer.frames();
                scope.spawn(move || while consumer.frames() == seen && !consumer.sleep(seen, LONG) {})
            })
            .collect();
        while driver.wake.word.load(Ordering::Relaxed) & ASLEEP == 0 {
            std::thread::yield_now();
        }
        driver.announce();
        sleepers.into_iter().for_each(|sleeper| sleeper.join().unwrap());
    });
}

#[test]
fn nobody_asleep_costs_no_wake_up_and_a_dead_sleeper_only_one() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    let word = || driver.wake.word.load(Ordering::Relaxed);
    driver.announce();
    assert_eq!(word() & ASLEEP, 0);
    // As a consumer that dies asleep leaves it.
    assert!(driver.sleep(driver.frames(), Duration::from_millis(1)));
    assert_eq!(word() & ASLEEP, ASLEEP);
    let frames = driver.frames();
    driver.announce();
    assert_eq!(word(), frames + 2);
}

/// On a thread of its own, which runs on one core; gives that core and those that the test may use.
fn on_one_core(test: impl FnOnce(usize, CpuSet) + Send) {
    std::thread::scope(|scope| {
        let on_it = || {
            let all = sched_getaffinity(None).unwrap();
            let core = sched_getcpu();
            let mut one = CpuSet::new();
            one.set(core);
            sched_setaffinity(None, &one).unwrap();
            test(core, all);
        };
        scope.spawn(on_it).join().unwrap();
    });
}

#[test]
fn who_is_going_to_watch_leaves_the_drivers_core_and_may_come_back() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    on_one_core(|core, all| {
        assert!(all.count() > 1, "needs two cores");
        driver.announce();
        sched_setaffinity(None, &all).unwrap();
        let aside = driver.step_aside().unwrap();
        assert_ne!(sched_getcpu(), core);
        assert!(!sched_getaffinity(None).unwrap().is_set(core));
        drop(aside);
        assert_eq!(sched_getaffinity(None).unwrap(), all);
    });
}

#[test]
fn who_may_use_no_other_core_stays() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    on_one_core(|core, _| {
        driver.announce();
        assert!(driver.step_aside().is_none());
        assert_eq!(sched_getcpu(), core);
    });
}

#[test]
fn a_core_that_is_not_told_or_cannot_be_is_nowhere() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    assert!(driver.step_aside().is_none());
    driver.wake.core.store(u32::MAX, Ordering::Relaxed);
    assert!(driver.step_aside().is_none());
}

#[test]
fn the_count_wraps() {
    let (_folder, path) = page();
    let driver = WakeWord::create(&path).unwrap();
    driver.wake.word.store(u32::MAX, Ordering::Relaxed);
    let seen = driver.frames();
    driver.announce();
    assert_eq!(driver.frames(), 0);
    assert!(!driver.sleep(seen, LONG));
}

#[test]
fn a_driver_takes_over_the_page_of_the_one_before_and_makes_another_where_it_was_removed() {
    let (_folder, path) = page();
    assert!(WakeWord::open(&path).unwrap().is_none());
    let first = WakeWord::create(&path).unwrap();
    first.announce();
    let consumer = WakeWord::open(&path).unwrap().unwrap();
    drop(first);
    let second = WakeWord::create(&path).unwrap();
    let seen = consumer.frames();
    second.announce();
    assert_ne!(consumer.frames(), seen);
    assert!(consumer.is_current());
    fs::remove_file(&path).unwrap();
    assert!(!consumer.is_current());
    let third = WakeWord::create(&path).unwrap();
    assert!(!consumer.is_current() && third.is_current());
}

#[test]
fn what_a_driver_keeps_is_found_by_the_next() {
    let (_folder, path) = page();
    let first = WakeWord::create(&path).unwrap();
    assert_eq!(first.kept(), None);
    let production = Production { counting: 1, produced: u64::from(u32::MAX) + 7, epoch: 3 };
    first.keep(&production);
    first.announce();
    drop(first);
    assert_eq!(WakeWord::create(&path).unwrap().kept(), Some(production));
    assert_eq!(WakeWord::open(&path).unwrap().unwrap().frames(), 2);
}

#[test]
fn what_a_driver_of_another_contract_kept_is_not_believed() {
    let (_folder, path) = page();
    let places: [fn(&Page) -> &AtomicU32; 2] =
        [|page| &page.identity.magic, |page| &page.identity.contract_version];
    for of_another in places {
        let driver = WakeWord::create(&path).unwrap();
        driver.keep(&Production { counting: 1, produced: 2, epoch: 3 });
        of_another(&driver).fetch_add(1, Ordering::Relaxed);
        assert_eq!(WakeWord::create(&path).unwrap().kept(), None);
    }
}

#[test]
fn a_page_that_is_not_finished_is_none() {
    let (_folder, path) = page();
    fs::write(&path, "").unwrap();
    assert!(WakeWord::open(&path).unwrap().is_none());
    fs::write(&path, [0; PAGE_BYTES]).unwrap();
    assert!(WakeWord::open(&path).unwrap().is_none());
}
