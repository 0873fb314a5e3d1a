//! The peers that are written in Rust: each way is one process of a chain.
#![allow(clippy::unwrap_used)]

use uvcam_shm_ipc::Wakeup;

mod alone;
mod iceoryx2;
mod source;
mod task;
mod uvcam;
mod window;

fn main() {
    let (way, task) = task::Task::from_arguments();
    match way.as_str() {
        "alone" => alone::run(&task),
        "iceoryx2-produce" => iceoryx2::produce(&task, false),
        "iceoryx2-poll" => iceoryx2::poll(&task, false),
        "iceoryx2-event" => iceoryx2::event(&task, false),
        "copy-produce" => iceoryx2::produce(&task, true),
        "copy-event" => iceoryx2::event(&task, true),
        "uvcam-poll" => uvcam::poll(&task),
        "uvcam-predictive" => uvcam::sleep(&task, Wakeup::Predictive),
        "uvcam-futex" => uvcam::sleep(&task, Wakeup::Futex),
        "uvcam-event" => uvcam::sleep(&task, Wakeup::Event),
        way => panic!("unknown way {way}"),
    }
}
