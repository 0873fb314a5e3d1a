//! UVDAR's rule on live frames, a line for each with markers: `uvdar_markers [CAMERA [PREFIX ROOT_PATH]]`. Masked frames of 8 bits.

use uvcam_shm_ipc::{IpcError, Settings, Subscriber};

/// Whether a pixel stands out from a whole ring of radius 3 or 4 around it. Where the ring is nearly as bright, it is the sun.
fn is_marker(rows: &[&[u8]], (x, y): (usize, usize)) -> Option<bool> {
    let centre = rows.get(y)?.get(x).filter(|pixel| **pixel >= 50)?;
    for quarter in [&[(3, 0), (3, 1), (2, 2), (1, 3)][..], &[(4, 0), (4, 1), (3, 2), (2, 3), (1, 4)]] {
        let ring = quarter.iter().flat_map(|&(a, b)| [(a, b), (-b, a), (-a, -b), (b, -a)]);
        let pixel = |(a, b)| rows.get(y.checked_add_signed(b)?)?.get(x.checked_add_signed(a)?);
        let ring: Vec<&u8> = ring.map(pixel).collect::<Option<_>>()?;
        if centre.saturating_sub(**ring.iter().max()?) >= 25 {
            return Some(true);
        } else if *centre >= 150 && centre.saturating_sub(**ring.iter().min()?) <= 25 {
            return Some(false);
        }
    }
    None
}

fn main() -> Result<(), IpcError> {
    let mut words = std::env::args().skip(1);
    let mut word = |default: &str| words.next().unwrap_or_else(|| default.to_owned());
    let (camera, settings) = (word("left"), Settings::new(word("uvcam_"), word("/tmp/uvcam")));
    let mut subscriber = Subscriber::open(&settings, &camera)?;
    loop {
        subscriber.wait(std::time::Duration::from_secs(1))?;
        while let Some(frame) = subscriber.receive()? {
            let rows: Vec<&[u8]> = frame.rows().collect();
            let pixels = (0..rows.len()).flat_map(|y| (0..rows[y].len()).map(move |x| (x, y)));
            let mut markers: Vec<(usize, usize)> = Vec::new();
            for (x, y) in pixels.filter(|at| is_marker(&rows, *at) == Some(true)) {
                let is_new = markers.iter().all(|it| it.0.abs_diff(x).pow(2) + it.1.abs_diff(y).pow(2) >= 25);
                markers.extend(is_new.then_some((x, y)));
            }
            println!("{}: {markers:?}", frame.header().device_frame_id);
        }
    }
}
