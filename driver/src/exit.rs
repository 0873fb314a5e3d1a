//! Exit codes: the one number that a script or a service manager sees.

/// How a command ended. The numbers are part of the public interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// The command did what was asked.
    Done = 0,
    /// The command line or the configuration is wrong.
    Usage = 2,
    /// Refused as unsafe: a mask that cannot fly, a setting that the camera did not take.
    Refused = 3,
    /// A camera is absent, or failed.
    Camera = 4,
    /// Shared memory cannot be used, or nobody publishes there.
    SharedMemory = 5,
    /// `uvcam doctor` found a fault of this machine.
    Fault = 6,
    /// The system refused something (a file, a thread, a signal), or a part of the program failed: another try may work.
    System = 7,
}

impl Exit {
    /// The exit that has this code; a code that none has is a failure.
    pub fn from_code(code: u8) -> Self {
        let all = [
            Exit::Done,
            Exit::Usage,
            Exit::Refused,
            Exit::Camera,
            Exit::SharedMemory,
            Exit::Fault,
            Exit::System,
        ];
        all.into_iter().find(|exit| *exit as u8 == code).unwrap_or(Exit::System)
    }
}

impl From<Exit> for std::process::ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
