//! What happens to the process of one camera costs its siblings nothing, and the camera a restart.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use uvcam_shm_ipc::Subscriber;
use uvcam_shm_ipc::health::State;
use uvcam_tests::dice::Dice;
use uvcam_tests::{Process, Stage, children, health_where, lives, next_frame, simulated, stderr, wait_until};

mod main_process;
mod memory;

const CAMERAS: [&str; 3] = ["left", "right", "back"];
const VICTIM: &str = "left";
const DEATHS: u64 = 50;

/// Small ones that stand still, and a second of frames in hand, so that what is lost tells of the driver and not of a busy machine.
fn three_cameras(faults_of_the_victim: &str) -> Stage {
    three_cameras_with("", faults_of_the_victim)
}

/// The same, with these keys at the configuration's top.
fn three_cameras_with(top: &str, faults_of_the_victim: &str) -> Stage {
    let camera = |name| {
        let faults = if name == VICTIM { faults_of_the_victim } else { "" };
        format!(
            "[[camera]]\nname = \"{name}\"\nwidth = 64\nheight = 48\nfps = 60\nexposure_us = 1000\nmask = \"none\"\n\
             source = {{ kind = \"simulated\", serial = \"{name}\", still = true{faults} }}\n"
        )
    };
    Stage::configured(top, &("buffer = 64\nslots = 64\n".to_owned() + &CAMERAS.map(camera).concat()))
}

/// The process of this camera, where one runs.
fn process_of(driver: &Process, camera: &str) -> Option<u32> {
    children(driver.id()).into_iter().find(|id| {
        let words = fs::read_to_string(format!("/proc/{id}/cmdline")).unwrap_or_default();
        words.contains(&format!("\0--camera\0{camera}\0")) && lives(*id)
    })
}

fn signal(id: u32, signal: Signal) {
    // One that has ended meanwhile is what was wanted.
    let _ = kill_process(Pid::from_raw(id.try_into().unwrap()).unwrap(), signal);
}

/// Has the process die of this signal. The runtime looks at the first SIGSEGV itself, and finds that it is not its own.
fn die(id: u32, by: Signal) {
    wait_until("its death", || {
        signal(id, by);
        !lives(id)
    });
}

/// Everything that the stage has in shared memory and in its folder of services.
fn left_behind(stage: &Stage) -> BTreeSet<String> {
    fn walk(folder: &Path, found: &mut BTreeSet<String>, wanted: &dyn Fn(&str) -> bool) {
        for file in fs::read_dir(folder).into_iter().flatten().flatten() {
            if wanted(&file.file_name().to_string_lossy()) {
                found.insert(file.path().display().to_string());
                walk(&file.path(), found, &|_| true);
            }
        }
    }
    let (mut found, settings) = (BTreeSet::new(), stage.settings());
    walk("/dev/shm".as_ref(), &mut found, &|name| name.starts_with(&settings.prefix));
    walk(&settings.root_path, &mut found, &|_| true);
    found
}

/// A consumer that reads without a pause, and what it has seen so far.
#[derive(Default)]
struct Seen {
    frames: AtomicU64,
    epochs: AtomicU64,
    is_over: AtomicBool,
}

impl Seen {
    /// Reads until it is over and nothing is unread.
    fn read(&self, mut subscriber: Subscriber) -> Account {
        let mut span = None;
        loop {
            let is_over = self.is_over.load(Ordering::Relaxed);
            while let Some(frame) = subscriber.receive().unwrap() {
                let produced = frame.header().produced;
                span = Some((span.map_or(produced, |(first, _)| first), produced));
                self.epochs.store(subscriber.epochs(), Ordering::Relaxed);
                self.frames.store(subscriber.frames(), Ordering::Relaxed);
            }
            if is_over {
                let (first, last) = span.unwrap();
                return (subscriber, first, last);
            }
            subscriber.wait(Duration::from_millis(20)).unwrap();
        }
    }

    /// Waits for a new epoch. Returns how long that took, in ms.
    fn wait_for_return(&self) -> u128 {
        let (end, epochs) = (Instant::now(), self.epochs.load(Ordering::Relaxed));
        wait_until("its return", || self.epochs.load(Ordering::Relaxed) > epochs);
        end.elapsed().as_millis()
    }

    fn wait_for_frames(&self, count: u64) {
        let before = self.frames.load(Ordering::Relaxed);
        wait_until("frames", || self.frames.load(Ordering::Relaxed) >= before + count);
    }
}

/// A consumer in the end, and `produced` of its first and last frame.
type Account = (Subscriber, u64, u64);

/// Reads all three cameras while this happens to them, from their first frames on.
fn observed<T>(stage: &Stage, happens: impl FnOnce(&[Seen; 3]) -> T) -> (T, Vec<Account>) {
    let seen: [Seen; 3] = Default::default();
    std::thread::scope(|scope| {
        let readers: Vec<_> = CAMERAS
            .iter()
            .zip(&seen)
            .map(|(camera, seen)| scope.spawn(|| seen.read(stage.subscriber(camera))))
            .collect();
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            seen.iter().for_each(|seen| seen.wait_for_frames(1));
            happens(&seen)
        }));
        seen.iter().for_each(|seen| seen.is_over.store(true, Ordering::Relaxed));
        let accounts = readers.into_iter().map(|reader| reader.join().unwrap()).collect();
        (outcome.unwrap(), accounts)
    })
}

/// Every account agrees, the victim has begun anew more than so often, and its siblings have noticed nothing.
fn assert_siblings_lost_nothing(accounts: Vec<Account>, deaths: u64, said: &str) {
    for (camera, (subscriber, first, last)) in CAMERAS.iter().zip(accounts) {
        let (received, told) = (subscriber.frames(), subscriber.lost());
        println!("{camera}: {received} received, {told} told, {} epochs", subscriber.epochs());
        assert_eq!(received + told, last - first + 1, "{camera}");
        if *camera == VICTIM {
            assert!(subscriber.epochs() > deaths);
        } else {
            assert_eq!((told, subscriber.epochs()), (0, 1), "{camera}, a sibling: {said}");
        }
    }
}

/// Lets the victim die so often, in every way, at random moments. Returns how long some of its returns took.
fn let_die(driver: &Process, victim: &Seen) -> Vec<u128> {
    let (mut dice, mut returns) = (Dice::new(), Vec::new());
    for death in 0..DEATHS {
        let mut process = None;
        wait_until("a process", || {
            process = process_of(driver, VICTIM);
            process.is_some()
        });
        let process = process.unwrap();
        match death % 10 {
            // Its script has a panic for it.
            5 => victim.wait_for_frames(20),
            // Hangs as a whole.
            9 => {
                victim.wait_for_frames(dice.roll(5));
                signal(process, Signal::STOP);
                wait_until("the end of a process that hangs", || !lives(process));
            }
            number => {
                match number % 2 {
                    0 => victim.wait_for_frames(dice.roll(20)),
                    // Also while it starts.
                    _ => std::thread::sleep(Duration::from_millis(dice.roll(150))),
                }
                // A crash, an abort, and what the kernel does where memory is short.
                die(process, [Signal::SEGV, Signal::ABORT, Signal::KILL][dice.roll(3) as usize]);
            }
        }
        // Every second time the next one comes while it starts.
        if !matches!(death % 10, 1 | 3 | 7 | 9) {
            continue;
        }
        returns.push(victim.wait_for_return());
    }
    victim.wait_for_frames(10);
    returns
}

#[test]
fn fifty_deaths_of_a_process_cost_its_siblings_nothing_and_leave_nothing_behind() {
    let stage = three_cameras(", faults = [{ kind = \"panic\", at_frame = 15 }]");
    // What a driver leaves that nothing happens to.
    let driver = stage.driver();
    CAMERAS.iter().for_each(|camera| _ = next_frame(&mut stage.subscriber(camera)));
    assert!(children(driver.id()).len() == 3);
    driver.stop();
    let expected = left_behind(&stage);

    let driver = stage.driver();
    let (returns, accounts) = observed(&stage, |seen| let_die(&driver, &seen[0]));
    assert_eq!(children(driver.id()).len(), 3);
    let output = driver.stop();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    println!("first frame so many ms after a death: {returns:?}");
    println!("files made anew {} times", said.matches("were removed by another program").count());
    assert_siblings_lost_nothing(accounts, DEATHS / 2, &said);
    assert_eq!(left_behind(&stage), expected);
}

#[test]
fn a_process_whose_camera_s_library_is_stuck_is_killed_and_the_camera_flies_again() {
    let stage = three_cameras(", faults = [{ kind = \"hang\", at_frame = 20, seconds = 1000.0 }]");
    let siblings = ["right", "back"].map(|camera| stage.watch(&[camera]));
    let mut victim = stage.subscriber(VICTIM);
    let driver = stage.driver();
    wait_until("its return", || victim.receive().unwrap().is_some() && victim.epochs() == 2);
    for sibling in siblings {
        sibling.signal(Signal::INT);
        let report = sibling.json();
        assert_eq!((report["lost"].as_u64(), report["epochs"].as_u64()), (Some(0), Some(1)), "{report}");
    }
    let said = stderr(&driver.stop());
    assert!(said.contains("left: a call into its library does not return: its process is killed"), "{said}");
    assert!(
        said.contains("left: its process has ended (signal: 9 (SIGKILL)), and is started again"),
        "{said}"
    );
}

#[test]
fn what_a_process_says_each_time_is_told_once_and_summed_up_when_it_works() {
    let stage = three_cameras("");
    let driver = stage.driver();
    let mut health = stage.health(VICTIM);
    for _ in 0..8 {
        let before = health_where("frames", &mut health, |health| health.published > 0);
        die(before.process_id, Signal::KILL);
        health_where("its return", &mut health, |health| health.process_id != before.process_id);
    }
    health_where("a while without a death", &mut health, |health| {
        let since = health.written_monotonic_ns.saturating_sub(health.state_since_monotonic_ns);
        health.state() == Ok(State::Streaming) && since > 11_000_000_000
    });
    let said = stderr(&driver.stop());
    // Once of the first process, once of those after it, and once a minute on a machine that is this slow.
    let told = |text: &str| said.matches(text).count();
    assert!((2..5).contains(&told("left: streaming, simulated")), "{said}");
    assert!((1..5).contains(&told("left: its process has ended")), "{said}");
    assert!(told("left: streaming for 10 s (messages not told before: ") == 1, "{said}");
    assert_eq!((told("right: streaming"), told("back: streaming")), (1, 1), "{said}");
}

#[test]
fn an_interrupt_at_the_terminal_reaches_all_processes_and_is_one_end() {
    let stage = three_cameras("");
    let mut victim = stage.subscriber(VICTIM);
    let driver = stage.driver();
    next_frame(&mut victim);
    CAMERAS.iter().for_each(|camera| _ = stage.process_of(camera));
    children(driver.id()).into_iter().for_each(|id| signal(id, Signal::INT));
    for _ in 0..30 {
        next_frame(&mut victim);
    }
    driver.signal(Signal::INT);
    let output = driver.finish();
    let said = stderr(&output);
    assert_eq!((output.status.code(), victim.epochs()), (Some(0), 1), "{said}");
    assert_eq!(said.matches("frames published, 0 lost").count(), 3, "{said}");
    assert!(!said.contains("its process"), "{said}");
}

#[test]
fn a_process_that_starts_in_flight_is_what_the_others_are_whoever_works_on_the_files() {
    let stage = three_cameras("");
    fs::copy(uvcam_tests::binary(), stage.file("uvcam")).unwrap();
    let mut command = std::process::Command::new(stage.file("uvcam"));
    let driver = Process::start(command.args(["run", "--config"]).arg(stage.file("uvcam.toml")));
    let mut health = stage.health(VICTIM);
    let before = health_where("frames", &mut health, |health| health.published > 0);
    fs::write(stage.file("uvcam.toml"), "[[camera]").unwrap();
    fs::remove_file(stage.file("uvcam")).unwrap();
    fs::write(stage.file("uvcam"), "half of the next version").unwrap();
    die(before.process_id, Signal::KILL);
    let after = health_where("frames of the next process", &mut health, |health| {
        health.published > 0 && health.process_id != before.process_id
    });
    assert_eq!(after.config_digest, before.config_digest);
    let name = fs::read_to_string(format!("/proc/{}/comm", after.process_id)).unwrap();
    assert_eq!(name, "uvcam\n");
    assert_eq!(driver.stop().status.code(), Some(0));
}

#[test]
fn one_process_runs_all_cameras_where_the_configuration_says_so() {
    let stage = Stage::in_one_process(&CAMERAS.map(|name| simulated(name, "none", "")).concat());
    let driver = stage.driver();
    for camera in CAMERAS {
        assert_eq!(stage.process_of(camera).as_raw_nonzero().get() as u32, driver.id());
    }
    assert!(children(driver.id()).is_empty());
    assert_eq!(driver.stop().status.code(), Some(0));
}

#[test]
fn the_process_of_a_camera_is_not_started_by_hand() {
    let stage = three_cameras("");
    for words in [["--camera", VICTIM, "--main-process", "1"], ["--camera", "nobody", "--main-process", "0"]]
    {
        let output = stage.output(&[&["run"][..], &words].concat());
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains("write `uvcam run`"), "{}", stderr(&output));
    }
}
