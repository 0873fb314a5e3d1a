//! What takes long, or may never return: reading a file that a person names, computing a mask, storing it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{SyncSender, sync_channel};

use crate::error::{Error, panic_text};
use crate::thread::spawn;

/// Jobs that may wait for the one at work.
const WAITING: usize = 8;

/// A thread that does one job after the other for one camera. It is left behind where a job does not return: the others do not wait for it,
/// nor does the end of the driver.
pub(super) struct Worker {
    jobs: SyncSender<Box<dyn FnOnce() + Send>>,
}

impl Worker {
    /// Starts the worker of this camera.
    ///
    /// # Errors
    /// [`Error::System`] where the system gives no thread.
    pub(super) fn start(camera: &str) -> Result<Self, Error> {
        let (jobs, inbox) = sync_channel::<Box<dyn FnOnce() + Send>>(WAITING);
        spawn(&format!("{camera}-files"), move || inbox.into_iter().for_each(|job| job()))?;
        Ok(Worker { jobs })
    }

    /// Gives it a job. What comes of it goes to `done`, on the worker's thread; a panic is an error in `part`.
    ///
    /// # Errors
    /// [`Error::Busy`] where too many jobs wait already; nothing is done then.
    pub(super) fn submit<T: 'static>(
        &self,
        part: &'static str,
        job: impl FnOnce() -> Result<T, Error> + Send + 'static,
        done: impl FnOnce(Result<T, Error>) + Send + 'static,
    ) -> Result<(), Error> {
        let job = move || {
            // The job owns all that it touches.
            let outcome = catch_unwind(AssertUnwindSafe(job));
            done(
                outcome.unwrap_or_else(|payload| Err(Error::Panicked { part, cause: panic_text(&*payload) })),
            );
        };
        self.jobs.try_send(Box::new(job)).map_err(|_| {
            Error::Busy(format!("{WAITING} jobs before this one are not done: a file does not answer"))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn a_panic_is_an_answer_and_the_worker_goes_on() {
        let (worker, (answers, inbox)) = (Worker::start("left").unwrap(), channel());
        let jobs: [fn() -> Result<u32, Error>; 3] = [|| Ok(1), || panic!("out of order"), || Ok(3)];
        for job in jobs {
            let answers = answers.clone();
            worker.submit("the job", job, move |outcome| answers.send(outcome).unwrap()).unwrap();
        }
        drop((worker, answers));
        let told: Vec<String> = inbox
            .into_iter()
            .map(|outcome| outcome.map_or_else(|error| error.to_string(), |number| number.to_string()))
            .collect();
        assert_eq!(told, ["1", "the job ended by a panic: out of order; please report it", "3"]);
    }

    #[test]
    fn jobs_behind_one_that_does_not_return_are_refused_and_never_waited_for() {
        let worker = Worker::start("left").unwrap();
        let (release, held) = channel::<()>();
        let hang = move || Ok(held.recv().is_ok());
        worker.submit("the job", hang, |_| ()).unwrap();
        let refused = (0..WAITING + 2).find_map(|_| worker.submit("the job", || Ok(()), |_| ()).err());
        let refused = refused.unwrap();
        assert!(refused.to_string().contains("a file does not answer"), "{refused}");
        assert_eq!(refused.exit(), crate::exit::Exit::System);
        drop(release);
    }
}
