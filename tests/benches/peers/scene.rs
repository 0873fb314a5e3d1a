//! Size, mask and number of the cameras that every chain serves, and the files that tell the peers.

use std::fmt;
use std::path::Path;

use serde::Serialize;
use uvcam::camera::simulated::airframe;
use uvcam_masker::Mask;
use uvcam_tests::{Stage, next_frame};

/// Pictures that the peers' cameras show in turn: as many backgrounds as the simulated camera has.
const PICTURES: usize = 8;
/// The size of UVDAR's cameras, px.
pub const SMALL: (u32, u32) = (752, 480);
/// The largest size that its masks have, px.
pub const LARGE: (u32, u32) = (1920, 1200);
/// How far the number of cameras grows.
pub const MOST_CAMERAS: usize = 6;
/// The masked band of frames of any size: columns and rows.
const BAND: (u32, u32) = (75, 480);

/// What a scene is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Purpose {
    /// All chains side by side.
    Comparison,
    /// What one more camera costs.
    MoreCameras,
    /// What a larger frame costs under a mask of the same area.
    LargerFrames,
}

/// Cameras of one kind, in a folder and shared memory of their own.
pub struct Scene {
    /// What it is for.
    pub purpose: Purpose,
    /// Folder, configuration and shared memory.
    pub stage: Stage,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How many cameras there are.
    pub cameras: usize,
    /// What is blanked in each.
    pub mask: Mask,
}

impl Scene {
    /// Cameras that see the simulated airframe, for all chains. Takes the peers' pictures from the driver.
    pub fn comparison((width, height): (u32, u32), cameras: usize) -> Scene {
        let mask = Mask::from_fn(width, height, airframe(width, height));
        let scene = Scene::new(Purpose::Comparison, cameras, mask);
        std::fs::write(scene.stage.file("frames.raw"), pictures(width, height)).unwrap();
        scene
    }

    /// The same for the driver alone, from one camera to `MOST_CAMERAS`.
    pub fn more_cameras() -> Vec<Scene> {
        let (width, height) = SMALL;
        let mask = || Mask::from_fn(width, height, airframe(width, height));
        (1..=MOST_CAMERAS).map(|cameras| Scene::new(Purpose::MoreCameras, cameras, mask())).collect()
    }

    /// A small frame and a large one, under masks of as many pixels in as many runs.
    pub fn larger_frames() -> Vec<Scene> {
        let mask = |(width, height)| Mask::from_fn(width, height, |x, y| x < BAND.0 && y < BAND.1);
        [SMALL, LARGE].map(|size| Scene::new(Purpose::LargerFrames, 1, mask(size))).into()
    }

    fn new(purpose: Purpose, cameras: usize, mask: Mask) -> Scene {
        let (width, height) = (mask.width(), mask.height());
        let names: Vec<String> = (0..cameras).map(|camera| format!("camera{camera}")).collect();
        let tables: String = names.iter().map(|name| table(name, "{camera}.png", width, height)).collect();
        let stage = Stage::new(&tables);
        for name in names {
            mask.save(&stage.file(&format!("{name}.png")), &[]).unwrap();
        }
        std::fs::write(stage.file("mask.raw"), mask.to_gray().into_raw()).unwrap();
        Scene { purpose, stage, width, height, cameras, mask }
    }

    /// Where its files lie.
    pub fn folder(&self) -> &Path {
        self.stage.folder()
    }
}

impl fmt::Display for Scene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}, {} cam", self.width, self.height, self.cameras)
    }
}

/// Reads `752x480`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').map(|(width, height)| (width.parse(), height.parse()));
    let Some((Ok(width), Ok(height))) = parsed else {
        return Err(format!("{text} is not a size such as 752x480"));
    };
    Ok((width, height))
}

/// Frames of the simulated camera, as they were before any mask.
fn pictures(width: u32, height: u32) -> Vec<u8> {
    let stage = Stage::new(&table("camera", "none", width, height));
    let mut subscriber = stage.subscriber("camera");
    let driver = stage.driver();
    let mut pictures = Vec::new();
    for _ in 0..PICTURES {
        pictures.extend_from_slice(next_frame(&mut subscriber).pixels());
    }
    drop(subscriber);
    assert!(driver.stop().status.success());
    pictures
}

/// A simulated camera at 60 fps in the driver's configuration.
fn table(name: &str, mask: &str, width: u32, height: u32) -> String {
    format!(
        "[[camera]]\nname = \"{name}\"\nsource = {{ kind = \"simulated\", serial = \"{name}\" }}\n\
         width = {width}\nheight = {height}\nfps = 60\nexposure_us = 1000\nmask = \"{mask}\"\n"
    )
}
