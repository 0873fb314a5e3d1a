//! The peers that are written in Rust: each way is one process of a chain.
#![allow(clippy::unwrap_used)]

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
        "uvcam-event" => uvcam::event(&task),
        way => panic!("unknown way {way}"),
    }
}
