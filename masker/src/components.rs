//! Connected components of a mask.
//!
//! Masked pixels that touch at a corner belong together (8-connected); white pixels must share an edge
//! (4-connected), so that a diagonal bridge does not hide a white islet.

use crate::mask::{Mask, Run};

/// One connected set of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Component {
    /// Number of pixels.
    pub area_px: u64,
    /// Leftmost column of the bounding box.
    pub x: u32,
    /// Topmost row of the bounding box.
    pub y: u32,
    /// Width of the bounding box in pixels.
    pub width: u32,
    /// Height of the bounding box in pixels.
    pub height: u32,
}

/// Neighbours that connect a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Connectivity {
    /// Left, right, above and below.
    Four,
    /// Those and the four diagonal ones.
    Eight,
}

/// The connected components of one colour of a mask, in the row order of their first pixels.
#[derive(Debug, Clone)]
pub struct Components {
    width: u32,
    height: u32,
    components: Vec<Component>,
    runs: Vec<(Run, usize)>,
}

impl Components {
    /// Components of the masked pixels, 8-connected.
    #[must_use]
    pub fn masked(mask: &Mask) -> Self {
        Self::connect(mask, mask.runs().to_vec(), Connectivity::Eight)
    }

    /// Components of the white pixels, 4-connected.
    #[must_use]
    pub fn white(mask: &Mask) -> Self {
        Self::connect(mask, white_runs(mask), Connectivity::Four)
    }

    /// The components; a component's index here is its index everywhere.
    #[must_use]
    pub fn list(&self) -> &[Component] {
        &self.components
    }

    /// Every run of this colour in row order, with the index of its component.
    pub fn runs(&self) -> impl ExactSizeIterator<Item = (Run, usize)> {
        self.runs.iter().copied()
    }

    /// One label a pixel in row order: 0 for the other colour, else the index of its component plus 1.
    #[must_use]
    pub fn labels(&self) -> Vec<u32> {
        let mut labels = vec![0; self.width as usize * self.height as usize];
        for (run, component) in &self.runs {
            let start = run.row as usize * self.width as usize + run.start as usize;
            labels[start..start + run.length as usize].fill(*component as u32 + 1);
        }
        labels
    }

    /// Union-find over runs instead of pixels; `runs` are sorted by row and column and never touch in their
    /// row.
    fn connect(mask: &Mask, runs: Vec<Run>, connectivity: Connectivity) -> Self {
        let reach = match connectivity {
            Connectivity::Four => 0,
            Connectivity::Eight => 1,
        };
        let mut parents: Vec<usize> = (0..runs.len()).collect();
        // The first run above that may still reach the current one.
        let mut above = 0;
        for (index, run) in runs.iter().enumerate() {
            let is_past = |upper: &Run| {
                upper.row + 1 < run.row
                    || (upper.row + 1 == run.row && upper.end().saturating_add(reach) <= run.start)
            };
            while is_past(&runs[above]) {
                above += 1;
            }
            let touching = runs[above..index].iter().take_while(|upper| {
                upper.row + 1 == run.row && upper.start < run.end().saturating_add(reach)
            });
            for (upper, _) in (above..).zip(touching) {
                unite(&mut parents, upper, index);
            }
        }

        let mut components: Vec<Component> = Vec::new();
        let mut of_root = vec![None; runs.len()];
        let mut labelled = Vec::with_capacity(runs.len());
        for (index, run) in runs.into_iter().enumerate() {
            let root = root(&mut parents, index);
            let component = *of_root[root].get_or_insert_with(|| {
                components.push(Component { area_px: 0, x: run.start, y: run.row, width: 0, height: 0 });
                components.len() - 1
            });
            components[component].include(&run);
            labelled.push((run, component));
        }
        Self { width: mask.width(), height: mask.height(), components, runs: labelled }
    }
}

impl Component {
    /// Whether the bounding box is below `size` pixels in both directions.
    #[must_use]
    pub fn is_below(&self, size: u32) -> bool {
        self.width < size && self.height < size
    }

    fn include(&mut self, run: &Run) {
        let right = run.end().max(self.x + self.width);
        self.area_px += u64::from(run.length);
        self.x = self.x.min(run.start);
        self.width = right - self.x;
        // Runs come in row order, so the newest row is the lowest.
        self.height = run.row + 1 - self.y;
    }
}

/// The gaps between the masked runs.
fn white_runs(mask: &Mask) -> Vec<Run> {
    let mut white = Vec::with_capacity(mask.runs().len() + mask.height() as usize);
    let mut masked = mask.runs().iter().peekable();
    for row in 0..mask.height() {
        let mut start = 0;
        while let Some(run) = masked.next_if(|run| run.row == row) {
            if run.start > start {
                white.push(Run { row, start, length: run.start - start });
            }
            start = run.end();
        }
        if mask.width() > start {
            white.push(Run { row, start, length: mask.width() - start });
        }
    }
    white
}

fn root(parents: &mut [usize], mut index: usize) -> usize {
    while parents[index] != index {
        // Halving the path keeps later searches short.
        parents[index] = parents[parents[index]];
        index = parents[index];
    }
    index
}

fn unite(parents: &mut [usize], a: usize, b: usize) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b)] = a.min(b);
}
