//! Writes the inputs that fuzzing begins with: `seeds FOLDER` fills a folder for each target.
//!
//! Pixels of PNG files are stored, not compressed, so that a changed byte is another pixel and not a broken stream; check sums are left
//! out, as the target gives them to every file.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::{env, fs, slice};

use libfuzzer_sys as _;
use uvcam::config::{Config, DEFAULT};
use uvcam_masker::Mask;
use uvcam_shm_ipc::control::{Reply, Request};
use uvcam_shm_ipc::health::Health;
use uvcam_shm_ipc::{FrameHeader, PixelFormat};

/// Side of the pictures, pixels: the least that fills all passes of an interlaced one.
const SIDE: u32 = 8;

/// Colour types of PNG, the samples of a pixel, and the depths that there are.
const COLOURS: [(u8, usize, &[u8]); 5] =
    [(0, 1, &[1, 2, 4, 8, 16]), (2, 3, &[8, 16]), (3, 1, &[1, 2, 4, 8]), (4, 2, &[8, 16]), (6, 4, &[8, 16])];

/// Adam7: first column and row of each pass, and the steps between columns and rows.
const PASSES: [[usize; 4]; 7] =
    [[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]];

const SOURCES: [&str; 5] = [
    r#"{ kind = "aravis", serial = "25003774" }"#,
    r#"{ kind = "v4l2", path = "/dev/video0", memory = "mmap", gain_step_db = 0.1, fixed_exposure_us = 1e3 }"#,
    r#"{ kind = "v4l2", serial = "A1B2C3D4", memory = "userptr" }"#,
    r#"{ kind = "replay", path = "frames" }"#,
    r#"{ kind = "simulated", serial = "SIM0", still = true, readout_us = 9700.0, faults = [
        { kind = "lost", at_frame = 100, count = 3 }, { kind = "hang", at_frame = 600, seconds = 5.0 }] }"#,
];

const CAMERA: &str = r#"
width = 752
height = 480
offset_x = 8
offset_y = 4
binning_horizontal = 1
binning_vertical = 2
pixel_format = "Mono12"
fps = 60.0
exposure_us = 1000.0
gain_db = -1.5
mask = "{uav}_{serial}_{camera}.png"
[camera.generate]
exposure_us = 5000.0
gain_db = 1
camera_place = "left"
ignore = ["0:10::", ":376:5:9"]
ignore_polygons = [[[0, 0], [9, 0], [9, 9]]]
sigma = 120
eta = 20
leaf = 10
k = 20
tau = 50.0
kappa = 50
[camera.realtime]
priority = 50
cpus = [0, 1]
"#;

const REQUESTS: [&str; 4] = [
    r#"{"request":"reload_mask"}"#,
    r#"{"request":"generate","accept":false,"method":"fused","frames":100,"ignore":[],"replace":false}"#,
    r#"{"request":"generate","accept":true,"method":"paper","frames":1,"ignore":[":3:1:"],"replace":true,"exposure_us":9e3,
        "gain_db":-1.0,"sigma":99,"eta":3,"leaf":10,"k":5,"tau":9.5,"kappa":3}"#,
    r#"{"request":"generate","accept":true,"method":"fused","frames":255,"ignore":["0:10::","5::7:"],"replace":false,"sigma":0,
        "eta":0,"kappa":1}"#,
];

const REPLIES: [&str; 4] = [
    r#"{"reply":"collecting","progress":{"frames":3,"most_frames":100,"lit_px":1200}}"#,
    r#"{"reply":"done"}"#,
    r#"{"reply":"failed","exit":3,"cause":"no"}"#,
    r#"{"reply":"generated","report":{"verdict":"ok","findings":[{"name":"too_dark","refuses":false,"message":"m"}],"frames_used":9,
        "candidates":8,"parts":[{"area_px":5,"perimeter_px":8.5,"compactness":1.25}],"seconds":0.5,"mask_id":"00",
        "overlap_with_mask_in_force":0.5,"file":"/a.png","in_force":true}}"#,
];

fn main() {
    let folder = PathBuf::from(env::args_os().nth(1).unwrap());
    pictures(&folder.join("png"));
    configurations(&folder.join("config"));
    records(&folder.join("header"));
    texts(&folder.join("control"));
    write(&folder.join("clock"), "bytes", &(0..=u8::MAX).collect::<Vec<_>>());
}

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join(name), bytes).unwrap();
}

fn pictures(folder: &Path) {
    for (colour, samples, depths) in COLOURS {
        for &depth in depths {
            for interlaced in [false, true] {
                let name =
                    format!("colour{colour}-depth{depth}{}.png", if interlaced { "-adam7" } else { "" });
                write(folder, &name, &picture(colour, samples, depth, interlaced));
            }
        }
    }
    // As the driver writes one, compressed.
    let texts = [("Method", "fused".to_owned()), ("Camera", "\u{3b1}".to_owned())];
    Mask::from_fn(24, 16, |x, y| x < 4 || y > 12).save(&folder.join("mask.png"), &texts).unwrap();
}

fn picture(colour: u8, samples: usize, depth: u8, interlaced: bool) -> Vec<u8> {
    let mut header = [SIDE.to_be_bytes(), SIDE.to_be_bytes()].concat();
    header.extend([depth, colour, 0, 0, u8::from(interlaced)]);
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    chunk(&mut png, b"IHDR", &header);
    match colour {
        3 => {
            chunk(&mut png, b"PLTE", &[255, 255, 255, 0, 0, 0]);
            chunk(&mut png, b"tRNS", &[255, 254]);
        }
        0 | 2 => chunk(&mut png, b"tRNS", &[0, 1].repeat(samples)),
        _ => {}
    }
    chunk(&mut png, b"eXIf", b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x01\0\0\0\0\0\0\0");
    chunk(&mut png, b"tEXt", b"Method\0fused");
    chunk(&mut png, b"zTXt", &[b"Parts\0\0".as_slice(), &stored(b"12 px")].concat());
    let rows = if interlaced { PASSES.map(Some).to_vec() } else { vec![None] };
    let rows = rows.into_iter().flat_map(|pass| {
        let [x, y, across, down] = pass.unwrap_or([0, 0, 1, 1]);
        let count = |first: usize, step: usize| (SIDE as usize - first).div_ceil(step);
        let bytes = (count(x, across) * samples * usize::from(depth)).div_ceil(8);
        // Each row without a filter; a mask of which the upper rows fly.
        (0..count(y, down)).flat_map(move |row| {
            let value = if colour != 3 && row < 4 { 255 } else { 0 };
            std::iter::once(0).chain(std::iter::repeat_n(value, bytes))
        })
    });
    chunk(&mut png, b"IDAT", &stored(&rows.collect::<Vec<_>>()));
    chunk(&mut png, b"iTXt", &[b"Camera\0\x01\0\0\0".as_slice(), &stored(b"left")].concat());
    chunk(&mut png, b"IEND", &[]);
    png
}

fn chunk(png: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    png.extend((data.len() as u32).to_be_bytes());
    png.extend(kind);
    png.extend(data);
    png.extend([0; 4]);
}

/// A zlib stream of one stored block.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len() as u16;
    let mut stream = vec![0x78, 1, 1];
    stream.extend(length.to_le_bytes());
    stream.extend((!length).to_le_bytes());
    stream.extend(bytes);
    stream.extend([0; 4]);
    stream
}

fn configurations(folder: &Path) {
    write(folder, "default.toml", DEFAULT.as_bytes());
    for (place, source) in SOURCES.iter().enumerate() {
        let ipc = "uav = \"uav1\"\n[ipc]\nprefix = \"p_\"\nroot_path = \"/tmp/p\"\nmax_subscribers = 2\nbuffer = 4\nborrowed = 1\nslots = 3\n";
        let text = format!("{ipc}[[camera]]\nname = \"left\"\nsource = {source}{CAMERA}");
        Config::parse(&text, Path::new("seed.toml")).unwrap();
        write(folder, &format!("source{place}.toml"), text.as_bytes());
    }
}

fn records(folder: &Path) {
    let mut several = Vec::new();
    for format in PixelFormat::ALL {
        for sequence in 0..3 {
            let stride = 64 * format.bytes_per_pixel() as u32;
            let mut header = FrameHeader::new(64, 48, stride, format);
            (header.epoch, header.sequence, header.frame_period_ns) = (7, sequence, 16_666_667);
            header.send_monotonic_ns = sequence * header.frame_period_ns;
            assert!(header.validate(stride as usize * 48).is_ok());
            several.extend([bytes_of(&header), bytes_of(&(stride as usize * 48))].concat());
        }
        write(folder, &format!("{format}"), &several);
    }
    write(folder, "health", bytes_of(&Health::new()));
}

/// The bytes of a record of the contract, which has no padding.
fn bytes_of<T: Copy>(record: &T) -> &[u8] {
    // SAFETY: a record without padding lies there for as long as it is borrowed.
    unsafe { slice::from_ref(record).align_to().1 }
}

fn texts(folder: &Path) {
    for (place, text) in REQUESTS.iter().enumerate() {
        text.parse::<Request>().unwrap();
        write(folder, &format!("request{place}.json"), text.as_bytes());
    }
    for (place, text) in REPLIES.iter().enumerate() {
        text.parse::<Reply>().unwrap();
        write(folder, &format!("reply{place}.json"), text.as_bytes());
    }
}
