//! The rectangles that a zonal cell can be cut into, and what each costs as a patch.

/// Second moments of the finest parts of a zonal cell, in the order of azimuth, then height; not centred.
#[derive(Clone, Debug)]
pub(super) struct Moments {
    /// Sum over pixels and channels, `[part][part]`.
    pub response: Vec<f64>,
    /// Mean over skies, `[part][part]`.
    pub light: Vec<f64>,
}

/// Halves of halves of a span, numbered as a heap: 1 is all of it, `2 k` and `2 k + 1` are the halves of `k`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stretch(pub usize);

impl Stretch {
    /// Cuts that lead to it.
    pub fn cuts(self) -> u8 {
        self.0.ilog2() as u8
    }

    /// The finest steps that it holds, of `2^finest`.
    fn steps(self, finest: u8) -> std::ops::Range<usize> {
        let long = 1usize << (finest - self.cuts());
        let from = (self.0 - (1 << self.cuts())) * long;
        from..from + long
    }
}

/// All rectangles of a zonal cell.
#[derive(Clone, Debug)]
pub(super) struct Boxes {
    /// Most cuts in height and azimuth.
    pub finest: [u8; 2],
    /// By [`Boxes::index`]: expected square error of the rectangle as a patch.
    errors: Vec<f64>,
    /// By cuts in azimuth: may be cut in height.
    flat: Vec<bool>,
}

impl Boxes {
    /// Of a zonal cell with these moments, under light whose finest parts vary by `white` on their own as well.
    pub fn new(moments: &Moments, white: f64, finest: [u8; 2], may_cut_height: impl Fn(u8) -> bool) -> Self {
        let flat: Vec<bool> = (0..=finest[1]).map(may_cut_height).collect();
        let mut boxes = Boxes { finest, errors: Vec::new(), flat };
        boxes.errors = vec![0.0; boxes.rows() * boxes.columns()];
        for height in 1..boxes.rows() {
            for azimuth in 1..boxes.columns() {
                let rectangle = [Stretch(height), Stretch(azimuth)];
                let at = boxes.index(rectangle);
                boxes.errors[at] = boxes.error_of(moments, white, rectangle);
            }
        }
        boxes
    }

    pub fn rows(&self) -> usize {
        2 << self.finest[0]
    }

    pub fn columns(&self) -> usize {
        2 << self.finest[1]
    }

    pub fn index(&self, [height, azimuth]: [Stretch; 2]) -> usize {
        height.0 * self.columns() + azimuth.0
    }

    pub fn error(&self, rectangle: [Stretch; 2]) -> f64 {
        self.errors[self.index(rectangle)]
    }

    /// The halves of a rectangle in height (axis 0) or azimuth (axis 1), where it may be cut.
    pub fn halves(&self, rectangle: [Stretch; 2], axis: usize) -> Option<[[Stretch; 2]; 2]> {
        let cuts = rectangle[axis].cuts();
        let may = cuts < self.finest[axis] && (axis == 1 || self.flat[usize::from(rectangle[1].cuts())]);
        may.then(|| {
            [0, 1].map(|side| {
                let mut half = rectangle;
                half[axis] = Stretch(2 * rectangle[axis].0 + side);
                half
            })
        })
    }

    /// `tr(C' G')` over the rectangle's parts, with both moments centred: with `H = 1 - 1 1^T / n` that is
    /// `sum C.G - 2/n (C 1).(G 1) + (sum C) (sum G) / n^2`; of white light `white * tr(G')`.
    fn error_of(&self, moments: &Moments, white: f64, [height, azimuth]: [Stretch; 2]) -> f64 {
        let rows = 1usize << self.finest[0];
        let all = rows << self.finest[1];
        let parts: Vec<usize> = azimuth
            .steps(self.finest[1])
            .flat_map(|column| height.steps(self.finest[0]).map(move |row| column * rows + row))
            .collect();
        let n = parts.len() as f64;
        let (mut both, mut sums, mut all_light, mut all_response, mut own) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for &i in &parts {
            let (mut light, mut response) = (0.0, 0.0);
            for &j in &parts {
                let c = moments.light[i * all + j];
                // The two samplings of the pilot change places.
                let g = 0.5 * (moments.response[i * all + j] + moments.response[j * all + i]);
                both += c * g;
                light += c;
                response += g;
            }
            own += moments.response[i * all + i];
            sums += light * response;
            all_light += light;
            all_response += response;
        }
        let smooth = both - 2.0 / n * sums + all_light * all_response / (n * n);
        smooth + white * (own - all_response / n)
    }
}
