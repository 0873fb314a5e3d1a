//! Consumers of the driver.

use std::thread;
use std::time::Duration;

use uvcam_shm_ipc::{Subscriber, Wakeup, monotonic_ns};
use uvcam_tests::SharedMemory;

use crate::task::Task;
use crate::window::{Stamps, Window};

/// Longest sleep before a look whether it is to end.
const NAP: Duration = Duration::from_millis(100);

/// Receives the frames of all cameras without a pause.
pub fn poll(task: &Task) {
    let window = Window::new(task, true);
    let mut subscribers = subscribers(task);
    thread::scope(|scope| {
        scope.spawn(|| ask(&mut subscribers, &window));
        window.conduct();
    });
}

/// Receives them in a thread for each camera, that sleeps until `wakeup` wakes it.
pub fn sleep(task: &Task, wakeup: Wakeup) {
    let window = Window::new(task, true);
    let mut subscribers = subscribers(task);
    thread::scope(|scope| {
        for (camera, subscriber) in subscribers.iter_mut().enumerate() {
            let window = &window;
            scope.spawn(move || {
                subscriber.set_wakeup(wakeup);
                while !window.is_over() {
                    subscriber.wait(NAP).unwrap();
                    receive(subscriber, camera, window);
                }
            });
        }
        window.conduct();
    });
}

fn subscribers(task: &Task) -> Vec<Subscriber> {
    let settings = SharedMemory::settings_in(&task.folder);
    (0..task.cameras).map(|camera| Subscriber::open(&settings, &format!("camera{camera}")).unwrap()).collect()
}

fn ask(subscribers: &mut [Subscriber], window: &Window) {
    while !window.is_over() {
        for (camera, subscriber) in subscribers.iter_mut().enumerate() {
            receive(subscriber, camera, window);
        }
    }
}

fn receive(subscriber: &mut Subscriber, camera: usize, window: &Window) {
    while let Some(frame) = subscriber.receive().unwrap() {
        let masked_ns = monotonic_ns();
        let header = frame.header();
        let stamps = Stamps {
            sequence: header.device_frame_id,
            ready_ns: header.arrival_monotonic_ns,
            send_ns: header.send_monotonic_ns,
            masked_ns,
        };
        window.received(camera, &stamps, frame.pixels());
    }
}
