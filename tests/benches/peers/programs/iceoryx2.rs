//! iceoryx2 without the driver: the floor, which sends frames as they are, and the plain way, which copies them into loaned slots and
//! masks them there by AND over every pixel.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use uvcam_shm_ipc::monotonic_ns;
use uvcam_tests::SharedMemory;

use crate::source::Source;
use crate::task::{Task, wait_for_end};
use crate::window::{Stamps, Window};

/// Longest sleep of a consumer before it looks whether it is to end.
const NAP: Duration = Duration::from_millis(100);
/// The first bytes of a frame are its place in the stream and its stamps, 8 bytes each, in this order.
const STAMPS: usize = 3;

/// Sends the frames of all cameras: of the plain way where `copied`, of the floor where not.
pub fn produce(task: &Task, copied: bool) {
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        for (camera, source) in Source::all(task).into_iter().enumerate() {
            let over = &over;
            scope.spawn(move || {
                let mask = copied.then(|| task.mask());
                walk(&Services::open(task, camera), source, mask.as_deref(), task.frame_bytes(), over);
            });
        }
        wait_for_end();
        // Relaxed on both sides: the flag carries no data.
        over.store(true, Ordering::Relaxed);
    });
}

fn walk(services: &Services, mut source: Source, mask: Option<&[u8]>, frame_bytes: usize, over: &AtomicBool) {
    let publisher = services
        .frames
        .publisher_builder()
        .initial_max_slice_len(frame_bytes)
        .allocation_strategy(AllocationStrategy::Static)
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .unwrap();
    let notifier = services.wake.notifier_builder().create().unwrap();
    let mut captured = vec![0; frame_bytes];
    while !over.load(Ordering::Relaxed) {
        let loan = publisher.loan_slice_uninit(frame_bytes).unwrap();
        let (sequence, picture) = source.next();
        let (mut sample, ready_ns) = match mask {
            None => (loan.write_from_slice(picture), monotonic_ns()),
            Some(mask) => {
                captured.copy_from_slice(picture);
                let ready_ns = monotonic_ns();
                let mut sample = loan.write_from_slice(&captured);
                sample.payload_mut().iter_mut().zip(mask).for_each(|(pixel, keep)| *pixel &= keep);
                (sample, ready_ns)
            }
        };
        let stamps = [sequence, ready_ns, monotonic_ns()];
        for (place, stamp) in sample.payload_mut().chunks_exact_mut(8).zip(stamps) {
            place.copy_from_slice(&stamp.to_le_bytes());
        }
        sample.send().unwrap();
        if services.wake.dynamic_config().number_of_listeners() > 0 {
            notifier.notify().unwrap();
        }
    }
}

/// Receives them without a pause.
pub fn poll(task: &Task, masked: bool) {
    let window = Window::new(task, masked);
    let services: Vec<_> = (0..task.cameras).map(|camera| (camera, Services::open(task, camera))).collect();
    thread::scope(|scope| {
        scope.spawn(|| ask(services, &window));
        window.conduct();
    });
}

/// Receives them in a thread for each camera, that sleeps until it is notified.
pub fn event(task: &Task, masked: bool) {
    let window = Window::new(task, masked);
    thread::scope(|scope| {
        for camera in 0..task.cameras {
            let window = &window;
            scope.spawn(move || sleep(Services::open(task, camera), camera, window));
        }
        window.conduct();
    });
}

fn ask(services: Vec<(usize, Services)>, window: &Window) {
    let subscribers: Vec<_> =
        services.iter().map(|(camera, services)| (*camera, services.subscriber())).collect();
    while !window.is_over() {
        for (camera, subscriber) in &subscribers {
            receive(subscriber, *camera, window);
        }
    }
}

fn sleep(services: Services, camera: usize, window: &Window) {
    let subscriber = services.subscriber();
    let listener = services.wake.listener_builder().create().unwrap();
    while !window.is_over() {
        listener.timed_wait(|_| (), NAP).unwrap();
        receive(&subscriber, camera, window);
    }
}

fn receive(subscriber: &Subscriber<ipc::Service, [u8], ()>, camera: usize, window: &Window) {
    while let Some(sample) = subscriber.receive().unwrap() {
        let masked_ns = monotonic_ns();
        let mut stamps = [0; STAMPS];
        for (stamp, place) in stamps.iter_mut().zip(sample.payload().chunks_exact(8)) {
            *stamp = u64::from_le_bytes(place.try_into().unwrap());
        }
        let [sequence, ready_ns, send_ns] = stamps;
        window.received(camera, &Stamps { sequence, ready_ns, send_ns, masked_ns }, sample.payload());
    }
}

/// The services of one camera, made as the driver makes its own.
struct Services {
    frames: publish_subscribe::PortFactory<ipc::Service, [u8], ()>,
    wake: event::PortFactory<ipc::Service>,
}

impl Services {
    fn open(task: &Task, camera: usize) -> Services {
        set_log_level_from_env_or(LogLevel::Error);
        let settings = SharedMemory::settings_in(&task.folder);
        let mut config = Config::default();
        config.global.prefix = FileName::new(settings.prefix.as_bytes()).unwrap();
        config.global.set_root_path(&Path::new(task.folder.to_str().unwrap().as_bytes()).unwrap());
        let node = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
        let frames = node
            .service_builder(&format!("peer/{camera}/frames").as_str().try_into().unwrap())
            .publish_subscribe::<[u8]>()
            .max_publishers(1)
            .max_subscribers(settings.max_subscribers)
            .subscriber_max_buffer_size(settings.buffer)
            .subscriber_max_borrowed_samples(settings.borrowed)
            .history_size(0)
            .enable_safe_overflow(true)
            .open_or_create()
            .unwrap();
        let wake = node
            .service_builder(&format!("peer/{camera}/wake").as_str().try_into().unwrap())
            .event()
            .max_notifiers(1)
            .open_or_create()
            .unwrap();
        Services { frames, wake }
    }

    fn subscriber(&self) -> Subscriber<ipc::Service, [u8], ()> {
        self.frames.subscriber_builder().create().unwrap()
    }
}
