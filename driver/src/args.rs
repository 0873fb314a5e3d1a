//! The command line. It only names things; [`crate::config`] and the commands give them meaning.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use uvcam_masker::generate::{LEAF_SIZES, Parameters};
use uvcam_shm_ipc::control::{EXPOSURE_US, FRAMES, GAIN_DB, GenerateRequest};

/// Onboard camera driver: fixed exposure, airframe mask applied in line, frames to every consumer without a copy.
#[derive(Debug, Parser)]
#[command(name = "uvcam", version, propagate_version = true)]
#[command(
    after_help = "Exit codes: 0 done, 2 usage or configuration, 3 refused as unsafe, 4 camera, 5 shared memory,\n\
    6 a fault of this machine, 7 refused by the system (a file, a thread), or failed inside.\n\
    Status goes to stderr, data to stdout. UVCAM_LOG=debug says more."
)]
pub struct Arguments {
    /// Configuration file; without it the built-in one is used (see `uvcam config`)
    #[arg(long, global = true, value_name = "FILE", env = "UVCAM_CONFIG")]
    pub config: Option<PathBuf>,
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the driver: capture, mask and publish every configured camera
    Run(Run),
    /// List the cameras that can be opened
    List(List),
    /// Read a camera's frames as any consumer would, and report what arrived
    Watch(Watch),
    /// Ask a running driver how its cameras are: state, losses, latencies
    Stats(Stats),
    /// Make a camera's mask from frames in which a lamp lights its airframe
    Generate(Generate),
    /// Work on mask files
    #[command(subcommand)]
    Mask(Mask),
    /// Say what is wrong on this machine, and the command that mends it
    Doctor(Doctor),
    /// Print the commented default configuration
    Config,
    /// Show the whole chain on a simulated camera, and leave pictures of it
    Demo(Demo),
}

/// `uvcam run`
#[derive(Debug, Args)]
pub struct Run {
    /// Stop after this many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub duration: Option<f64>,
    /// Run this camera alone, as a part of the driver that has started this process
    #[arg(long, value_name = "NAME", hide = true, requires = "main_process", conflicts_with = "duration")]
    pub camera: Option<String>,
    /// Id of the process that has started this one, and with which it is to end
    #[arg(long, value_name = "PID", hide = true, requires = "camera")]
    pub main_process: Option<u32>,
}

/// `uvcam list`
#[derive(Debug, Args)]
pub struct List {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `uvcam watch`
#[derive(Debug, Args)]
pub struct Watch {
    /// Name of the camera in the driver's configuration
    pub camera: String,
    /// Stop after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub frames: Option<u64>,
    /// Stop after this many seconds without a frame
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub timeout: Option<f64>,
    /// Count masked pixels that are not black under this mask
    #[arg(long, value_name = "FILE")]
    pub mask: Option<PathBuf>,
    /// Save every frame as PNG in this folder
    #[arg(long, value_name = "DIR")]
    pub save: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `uvcam stats`
#[derive(Debug, Args)]
pub struct Stats {
    /// Name of the camera in the driver's configuration; without it, every configured camera
    pub camera: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `uvcam generate`
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("source").required(true).args(["camera", "all", "from"]))]
pub struct Generate {
    /// Name of the camera in the configuration
    pub camera: Option<String>,
    /// Every configured camera, one after the other
    #[arg(long)]
    pub all: bool,
    /// Make the mask from pictures instead of a camera's frames; the published method takes the first
    #[arg(long, value_name = "FRAME.png", num_args = 1.., requires = "out", conflicts_with = "accept")]
    pub from: Vec<PathBuf>,
    /// Where to write the mask
    #[arg(long, value_name = "MASK.png", requires = "from")]
    pub out: Option<PathBuf>,
    /// Put the mask in force at once, without a look at the candidate
    #[arg(long)]
    pub accept: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// How the mask is computed
    #[arg(long, value_enum, default_value_t)]
    pub method: Method,
    /// Most frames of the fused method
    #[arg(long, value_name = "N", default_value_t = GenerateRequest::default().frames)]
    #[arg(help = format!("Frames that the fused method takes at most, {} to {}", FRAMES.least, FRAMES.most))]
    pub frames: u32,
    /// Columns x0 to x1 and rows y0 to y1 that are not the airframe, H_cam; an empty end is the image border
    #[arg(long, value_name = "X0:X1:Y0:Y1", allow_hyphen_values = true)]
    pub ignore: Vec<String>,
    /// Make a mask that is very different from the one in force, for another airframe or another place of the camera
    #[arg(long)]
    pub replace: bool,
    /// Exposure time
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    #[arg(help = format!("Exposure time of lit frames, {EXPOSURE_US}"))]
    pub exposure_us: Option<f64>,
    /// Gain
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    #[arg(help = format!("Gain of lit frames, {GAIN_DB}"))]
    pub gain_db: Option<f64>,
    /// sigma
    #[arg(long, value_name = "LEVEL")]
    #[arg(help = format!(
        "sigma: a pixel brighter than this is a candidate, {}; with the fused method, light below a quarter of it is too weak",
        range(&Parameters::SIGMA)
    ))]
    pub sigma: Option<u32>,
    /// eta
    #[arg(long, value_name = "PIXELS")]
    #[arg(help = format!("eta: the mask needs more candidates |P| than this, {}", range(&Parameters::ETA)))]
    pub eta: Option<u32>,
    /// Bucket size of the k-d tree
    #[arg(long, value_name = "POINTS")]
    #[arg(help = format!(
        "Bucket size of the k-d tree of the published method, one of {LEAF_SIZES:?}; matters for speed alone"
    ))]
    pub leaf: Option<u32>,
    /// k
    #[arg(long, value_name = "POINTS")]
    #[arg(help = format!(
        "k: neighbours that the published method connects with each candidate, itself included, {}",
        range(&Parameters::K)
    ))]
    pub k: Option<u32>,
    /// tau
    #[arg(long, value_name = "PIXELS")]
    #[arg(help = format!(
        "tau: the published method connects neighbours nearer than this, up to {}",
        Parameters::LARGEST_TAU
    ))]
    pub tau: Option<f64>,
    /// kappa
    #[arg(long, value_name = "PIXELS")]
    #[arg(help = format!(
        "kappa: thickness of the drawn contours, {}; the mask grows by half of it",
        range(&Parameters::KAPPA)
    ))]
    pub kappa: Option<u32>,
}

/// `--method`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Several frames while the lamp moves; ends when the mask has stopped changing
    #[default]
    Fused,
    /// The published method, from one frame
    Paper,
}

/// `uvcam mask`
#[derive(Debug, Subcommand)]
pub enum Mask {
    /// Say whether a mask can fly, and what is wrong with it
    Check(MaskCheck),
    /// Blank the masked pixels of a picture
    Apply(MaskApply),
    /// Make a mask binary and fill white holes and islets below 8 px
    Repair(MaskRepair),
    /// Measure the parts of masks: area, perimeter, compactness
    Metrics(MaskMetrics),
    /// Put a camera's generated candidate in force
    Accept(MaskOf),
    /// Remove a camera's generated candidate
    Discard(MaskOf),
    /// List the masks that were in force before
    History(MaskOf),
    /// Put a mask of the history in force again
    Restore(MaskRestore),
}

/// `uvcam mask check`
#[derive(Debug, Args)]
pub struct MaskCheck {
    /// The mask, a PNG
    pub file: PathBuf,
    /// Size of the camera's image, px
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `uvcam mask apply`
#[derive(Debug, Args)]
pub struct MaskApply {
    /// The mask, a PNG
    #[arg(long, value_name = "FILE")]
    pub mask: PathBuf,
    /// The picture, a PNG
    #[arg(value_name = "IN.png")]
    pub input: PathBuf,
    /// Where to write the masked picture
    #[arg(value_name = "OUT.png")]
    pub output: PathBuf,
}

/// `uvcam mask repair`
#[derive(Debug, Args)]
pub struct MaskRepair {
    /// Grey level from which a pixel is kept; needed where the mask is not binary
    #[arg(long, value_name = "LEVEL", value_parser = clap::value_parser!(u8).range(1..))]
    pub threshold: Option<u8>,
    /// The mask, a PNG
    #[arg(value_name = "IN.png")]
    pub input: PathBuf,
    /// Where to write the repaired mask
    #[arg(value_name = "OUT.png")]
    pub output: PathBuf,
}

/// `uvcam mask metrics`
#[derive(Debug, Args)]
pub struct MaskMetrics {
    /// The masks, PNG files
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Print JSON
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,
    /// Print comma-separated values, a line for each part
    #[arg(long)]
    pub csv: bool,
}

/// `uvcam mask accept`, `discard`, `history`
#[derive(Debug, Args)]
pub struct MaskOf {
    /// Name of the camera in the configuration
    pub camera: String,
}

/// `uvcam mask restore`
#[derive(Debug, Args)]
pub struct MaskRestore {
    /// Name of the camera in the configuration
    pub camera: String,
    /// Which one: 1 is the newest (see `uvcam mask history`)
    #[arg(default_value_t = 1)]
    pub number: usize,
}

/// `uvcam doctor`
#[derive(Debug, Args)]
pub struct Doctor {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Folder that stands for `/`, for tests and for disks of other machines
    #[arg(long, value_name = "DIR", default_value = "/", hide = true)]
    pub root: PathBuf,
}

/// `uvcam demo`
#[derive(Debug, Args)]
pub struct Demo {
    /// Folder for input.png, mask.png and masked.png
    #[arg(long, value_name = "DIR", default_value = "demo")]
    pub out: PathBuf,
    /// How long to run
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds)]
    pub seconds: f64,
}

fn range(range: &RangeInclusive<u32>) -> String {
    format!("{} to {}", range.start(), range.end())
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("\"{text}\" is not a number of seconds"))?;
    // The bound keeps the value inside what Duration can hold.
    if value.is_finite() && value > 0.0 && value <= 1e9 {
        Ok(value)
    } else {
        Err(format!("{text} s is not between 0 and 1e9 s"))
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || format!("\"{text}\" is not a size such as 752x480");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    match (width.parse(), height.parse()) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok((width, height)),
        _ => Err(wrong()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn sizes_and_seconds_refuse_nonsense() {
        assert_eq!(size("752x480"), Ok((752, 480)));
        for text in ["752", "752x", "0x480", "-1x4", "752X480", "99999999999x1"] {
            assert!(size(text).is_err(), "{text}");
        }
        assert_eq!(seconds("1.5"), Ok(1.5));
        for text in ["0", "-1", "nan", "inf", "1e300", "soon"] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }
}
