//! The camera's colours from a photographed chart.
//!
//! The white balance comes from the chart's grey patches alone, and the matrix must leave grey as it is (its rows are bound to
//! the white): a sky is nearly grey, and an error there is seen everywhere, while one in a saturated patch is seen nowhere.
//! The matrix's six free numbers make the sum of squared CIE L*a*b* differences least (Finlayson & Drew 1997, *White-point
//! preserving color correction*, in L*a*b* instead of linear light).
//!
//! A chart's published colours are those under D50. They are adapted (Bradford) to the daylight the chart stood in: what a
//! camera must tell is the light as it is, bluish in the shade, not as eyes that got used to it see it.

use super::CameraColour;
use super::difference::delta_e_2000;
use super::spaces::{D50, D65, REC709_OF_XYZ, Triple, XYZ_OF_REC709, adapt, apply, daylight, lab, xyz_of_lab};
use crate::camera::Frame;
use crate::least_squares::minimise;
use crate::linear_system::solve;
use crate::response::Response;

/// CIE L*a*b* (D50, 2 degree observer) of the 24 patches of the ColorChecker Classic, row by row from dark skin to black, as
/// its maker published them for charts made before November 2014.
#[rustfmt::skip]
pub const COLORCHECKER_LAB_D50: [Triple; 24] = [
    [37.986, 13.555, 14.059], [65.711, 18.13, 17.81], [49.927, -4.88, -21.925],
    [43.139, -13.095, 21.905], [55.112, 8.844, -25.399], [70.719, -33.397, -0.199],
    [62.661, 36.067, 57.096], [40.02, 10.41, -45.964], [51.124, 48.239, 16.248],
    [30.325, 22.976, -21.587], [72.532, -23.709, 57.255], [71.941, 19.363, 67.857],
    [28.778, 14.179, -50.297], [55.261, -38.342, 31.37], [42.101, 53.378, 28.19],
    [81.733, 4.039, 79.819], [51.935, 49.986, -14.574], [51.038, -28.631, -28.638],
    [96.539, -0.425, 1.186], [81.257, -0.638, -0.335], [66.766, -0.734, -0.504],
    [50.867, -0.153, -0.27], [35.656, -0.421, -1.231], [20.461, -0.079, -0.973],
];

/// Largest chroma of a grey patch, and its smallest lightness (darker ones are noise).
const GREY_CHROMA: f64 = 4.0;
const GREY_LIGHTNESS: f64 = 30.0;
/// Code / max from which a pixel counts as clipped.
const CLIP: f64 = 250.0 / 255.0;
/// Turns of white balance and matrix.
const TURNS: usize = 4;
/// Patches that the six numbers of a matrix need, the grey ones not counted.
const MIN_COLOURED: usize = 6;

/// Why a chart could not be used; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChartError {
    /// The list of patches is not what it should be.
    #[error("{name}: line {line}: {what}")]
    List {
        /// File name.
        name: String,
        /// Line number, from 1.
        line: usize,
        /// What is wrong and what to do.
        what: String,
    },
    /// A patch does not lie in the picture.
    #[error("patch {0} does not lie within the picture; check its position (pixels)")]
    Outside(usize),
    /// A patch is too bright for the frame.
    #[error("patch {0} is clipped; take the chart with a shorter exposure")]
    Clipped(usize),
    /// A patch shows nothing.
    #[error("patch {0} is black; check its position, or take the chart with a longer exposure")]
    Black(usize),
    /// Without grey there is no white balance.
    #[error("the chart has no grey patch (chroma below {GREY_CHROMA}, lightness above {GREY_LIGHTNESS}); add one")]
    NoGrey,
    /// Too few patches.
    #[error("{0} coloured patches are too few for a matrix; {MIN_COLOURED} are needed")]
    TooFew(usize),
    /// No matrix fits.
    #[error("no matrix fits the patches; check their order and positions")]
    NoFit,
}

/// A patch of a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Its centre in the picture, pixels.
    pub center_px: [f64; 2],
    /// Its colour as XYZ under D50, white = 1.
    pub xyz_d50: Triple,
}

/// What the camera made of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The camera's linear colours, full-well fractions.
    pub camera: Triple,
    /// The patch's colour as XYZ under D50.
    pub xyz_d50: Triple,
}

/// What the chart told.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartFit {
    /// The camera's colours.
    pub colour: CameraColour,
    /// CIEDE2000 per patch with white balance alone.
    pub balanced_only: Vec<f64>,
    /// CIEDE2000 per patch with the matrix.
    pub fitted: Vec<f64>,
    /// CIEDE2000 per patch with a matrix that was fitted to the others.
    pub left_out: Vec<f64>,
}

/// Reads a list of patches: a header `x,y,L,a,b` (CIE L*a*b* under D50) or `x,y,R,G,B` (linear Rec.709, white = 1), then a row
/// per patch; x and y are its centre in pixels. `name` is what errors call it.
///
/// # Errors
/// [`ChartError::List`], naming the line.
pub fn read_patches(text: &str, name: &str) -> Result<Vec<Patch>, ChartError> {
    let bad = |line: usize, what: String| ChartError::List { name: name.into(), line, what };
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let header: String = lines.next().map(|(_, line)| line.split_whitespace().collect()).unwrap_or_default();
    let is_lab = match header.as_str() {
        "x,y,L,a,b" => true,
        "x,y,R,G,B" => false,
        other => return Err(bad(1, format!("`{other}`: the header must be x,y,L,a,b or x,y,R,G,B"))),
    };
    let patch = |(index, line): (usize, &str)| {
        let fields: Vec<f64> =
            line.split(',').map_while(|f| f.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let [x, y, colour @ ..] = <[f64; 5]>::try_from(fields)
            .map_err(|_| bad(index + 1, format!("`{line}`: write five numbers {header}")))?;
        let xyz_d50 = if is_lab { xyz_of_lab(colour, D50) } else { adapt(apply(&XYZ_OF_REC709, colour), D65, D50) };
        Ok(Patch { center_px: [x, y], xyz_d50 })
    };
    lines.map(patch).collect()
}

/// The patches of a ColorChecker Classic whose corner patches (dark skin, bluish green, black, white) have these centres.
pub fn colorchecker([top_left, top_right, bottom_right, bottom_left]: [[f64; 2]; 4]) -> Vec<Patch> {
    let mix = |a: [f64; 2], b: [f64; 2], t: f64| -> [f64; 2] { std::array::from_fn(|k| a[k] + t * (b[k] - a[k])) };
    let patch = |(index, lab): (usize, &Triple)| {
        let (across, down) = ((index % 6) as f64 / 5.0, (index / 6) as f64 / 3.0);
        let center_px = mix(mix(top_left, top_right, across), mix(bottom_left, bottom_right, across), down);
        Patch { center_px, xyz_d50: xyz_of_lab(*lab, D50) }
    };
    COLORCHECKER_LAB_D50.iter().enumerate().map(patch).collect()
}

/// Mean linear colour of every patch: over a square around its centre, half as wide as the nearest two patches are apart.
///
/// # Errors
/// [`ChartError`], naming the patch (from 1) that lies outside, is clipped or black.
pub fn sample(frame: &Frame, response: &Response, patches: &[Patch]) -> Result<Vec<Sample>, ChartError> {
    let apart = |a: &Patch, b: &Patch| (a.center_px[0] - b.center_px[0]).hypot(a.center_px[1] - b.center_px[1]);
    let pairs = patches.iter().enumerate().flat_map(|(i, a)| patches[i + 1..].iter().map(move |b| apart(a, b)));
    let half = (0.25 * pairs.fold(f64::INFINITY, f64::min)).clamp(0.5, 64.0);
    patches.iter().enumerate().map(|(index, patch)| sample_one(frame, response, patch, half, index + 1)).collect()
}

fn sample_one(
    frame: &Frame,
    response: &Response,
    patch: &Patch,
    half: f64,
    number: usize,
) -> Result<Sample, ChartError> {
    let [x, y] = patch.center_px;
    if x - half < 0.0 || y - half < 0.0 || x + half > frame.width as f64 || y + half > frame.height as f64 {
        return Err(ChartError::Outside(number));
    }
    let max = f64::from(frame.codes.max());
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for row in (y - half) as usize..((y + half).ceil() as usize).min(frame.height) {
        for col in (x - half) as usize..((x + half).ceil() as usize).min(frame.width) {
            let code = |k: usize| f64::from(frame.codes.get(3 * (row * frame.width + col) + k)) / max;
            if (0..3).any(|k| code(k) >= CLIP) {
                return Err(ChartError::Clipped(number));
            }
            sum = std::array::from_fn(|k| sum[k] + response.fraction(code(k), k));
            count += 1.0;
        }
    }
    let camera = sum.map(|v| v / count);
    if camera.iter().any(|&v| v <= 0.0) {
        return Err(ChartError::Black(number));
    }
    Ok(Sample { camera, xyz_d50: patch.xyz_d50 })
}

/// A sample as the fit needs it: the camera's colours with the chart's white as 1, and the true XYZ under the chart's light.
struct Balanced {
    camera: Triple,
    xyz: Triple,
}

/// Fits the camera's colours; `light_k` is the temperature of the daylight that the chart stood in, kelvin.
///
/// # Errors
/// [`ChartError`] without grey patches or with too few coloured ones.
pub fn fit(samples: &[Sample], light_k: f64) -> Result<ChartFit, ChartError> {
    let white = daylight(light_k);
    let (greys, coloured) = greys(samples);
    if greys.is_empty() {
        return Err(ChartError::NoGrey);
    }
    if coloured < MIN_COLOURED {
        return Err(ChartError::TooFew(coloured));
    }
    // Grey patches are not quite grey: what the camera makes of their tint follows from the matrix of the turn before.
    let mut matrix = from_free(&IDENTITY, white);
    let mut balanced = Vec::new();
    let mut camera_white = [1.0; 3];
    for _ in 0..TURNS {
        camera_white = self::camera_white(&greys, &matrix, white).ok_or(ChartError::NoFit)?;
        balanced = samples.iter().map(|sample| sample.balanced(camera_white, white)).collect();
        matrix = self::matrix(&balanced.iter().collect::<Vec<_>>(), white).ok_or(ChartError::NoFit)?;
    }
    let differences = |matrix: &[Triple; 3]| balanced.iter().map(|b| difference(b, matrix, white)).collect();
    let left_out = (0..balanced.len()).map(|index| {
        let others: Vec<&Balanced> = balanced.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, b)| b).collect();
        self::matrix(&others, white).map_or(f64::NAN, |matrix| difference(&balanced[index], &matrix, white))
    });
    Ok(ChartFit {
        colour: factored(&matrix, camera_white).ok_or(ChartError::NoFit)?,
        balanced_only: differences(&from_free(&IDENTITY, white)),
        left_out: left_out.collect(),
        fitted: differences(&matrix),
    })
}

impl Sample {
    fn balanced(&self, camera_white: Triple, white: Triple) -> Balanced {
        let camera = std::array::from_fn(|k| self.camera[k] / camera_white[k]);
        Balanced { camera, xyz: adapt(self.xyz_d50, D50, white) }
    }
}

/// The grey patches, and how many are coloured.
fn greys(samples: &[Sample]) -> (Vec<&Sample>, usize) {
    let lab_of = |s: &Sample| lab(s.xyz_d50, D50);
    let is_coloured = |s: &&Sample| lab_of(s)[1].hypot(lab_of(s)[2]) >= GREY_CHROMA;
    let (coloured, greys): (Vec<&Sample>, Vec<&Sample>) = samples.iter().partition(is_coloured);
    (greys.into_iter().filter(|s| lab_of(s)[0] > GREY_LIGHTNESS).collect(), coloured.len())
}

/// The camera's colour of a perfect white in the chart's light, from the grey patches, by least squares; `matrix` takes balanced
/// camera colours to Rec.709.
fn camera_white(greys: &[&Sample], matrix: &[Triple; 3], white: Triple) -> Option<Triple> {
    let tint = |s: &&Sample| made_of(matrix, apply(&REC709_OF_XYZ, adapt(s.xyz_d50, D50, white)));
    let tints: Vec<Triple> = greys.iter().map(tint).collect();
    let sum =
        |k: usize, of: &dyn Fn(&Sample, f64) -> f64| greys.iter().zip(&tints).map(|(s, t)| of(s, t[k])).sum::<f64>();
    let found = std::array::from_fn(|k| sum(k, &|s, tint| s.camera[k] * tint) / sum(k, &|_, tint| tint * tint));
    found.iter().all(|v: &f64| v.is_finite()).then_some(found)
}

/// The colour that a matrix makes `colour` of; not finite where there is none.
fn made_of(matrix: &[Triple; 3], colour: Triple) -> Triple {
    solve(*matrix, colour.map(|v| [v])).map(|row| row[0])
}

/// The six free numbers of a matrix that leaves red, green and blue as they are.
const IDENTITY: [f64; 6] = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0];

/// The matrix of six free numbers: each row's third follows from the white, which it must hit.
fn from_free(free: &[f64], white: Triple) -> [Triple; 3] {
    let rgb = apply(&REC709_OF_XYZ, white);
    std::array::from_fn(|row| {
        let (first, second) = (free[2 * row] * rgb[row], free[2 * row + 1] * rgb[row]);
        [first, second, rgb[row] - first - second]
    })
}

/// The matrix from balanced camera colours to Rec.709 with the least L*a*b* differences.
fn matrix(samples: &[&Balanced], white: Triple) -> Option<[Triple; 3]> {
    let residuals = |free: &[f64]| {
        let matrix = from_free(free, white);
        let off = |b: &&Balanced| {
            let found = lab(apply(&XYZ_OF_REC709, apply(&matrix, b.camera)), white);
            let truth = lab(b.xyz, white);
            (0..3).map(move |k| found[k] - truth[k])
        };
        Some(samples.iter().flat_map(off).collect::<Vec<f64>>())
    };
    Some(from_free(&minimise(&IDENTITY, &[1e-5; 6], residuals)?.parameters, white))
}

fn difference(sample: &Balanced, matrix: &[Triple; 3], white: Triple) -> f64 {
    let found = lab(apply(&XYZ_OF_REC709, apply(matrix, sample.camera)), white);
    delta_e_2000(found, lab(sample.xyz, white))
}

/// White balance and matrix of one product, as `CAMERA.json` holds them: what the camera makes of D65 becomes grey.
fn factored(matrix: &[Triple; 3], camera_white: Triple) -> Option<CameraColour> {
    let whole: [Triple; 3] = matrix.map(|row| std::array::from_fn(|k| row[k] / camera_white[k]));
    let d65 = made_of(&whole, [1.0; 3]);
    let fits = d65.iter().all(|&v| v.is_finite() && v > 0.0);
    fits.then(|| CameraColour {
        white_balance: d65.map(|v| d65[1] / v),
        matrix: whole.map(|row| std::array::from_fn(|k| row[k] * d65[k])),
    })
}
