//! The rival: the dense f32 sum of the paper, by OpenBLAS, over the covered pixels only.
//!
//! It gets every help that costs the method nothing: one thread like the others, large pages, the fastest of three
//! layouts on this machine, exposure folded into the weights. Its 8-bit codes come from the same tone kernel as
//! Relume's, and it needs no compositing: it stores the codes of covered pixels and leaves the others alone.

use relume_firmware::kernel::Kernel;

use super::matrix::{Layout, Matrix};
use super::method::{BenchSky, Method, Shown};
use super::openblas::Blas;
use super::report::DENSE_NAME;

/// The dense sum with its matrix and buffers.
pub struct Dense {
    blas: Blas,
    channels: [Matrix; 3],
    layout: Layout,
    patches: usize,
    has_sun: bool,
    weights: Vec<f32>,
    linear: [Vec<f32>; 3],
    kernel: Kernel,
    /// Place in the picture of every covered pixel.
    covered: Vec<u32>,
    framebuffer: Vec<u32>,
}

impl Dense {
    /// Takes the memory for the `covered` pixels of a picture of `picture_px` pixels, chooses the layout and fills in
    /// made-up values, which is enough for timing. Fill in real ones by [`Dense::set_column`].
    ///
    /// # Errors
    /// When the memory cannot be had or the matrix does not fit OpenBLAS's integers.
    pub fn new(
        blas: Blas,
        covered: Vec<u32>,
        picture_px: usize,
        patches: usize,
        has_sun: bool,
    ) -> anyhow::Result<Self> {
        let (rows, cols) = (covered.len(), patches + usize::from(has_sun));
        anyhow::ensure!(Blas::fits(rows, cols), "{rows} pixels x {cols} patches do not fit OpenBLAS's integers");
        let mut red = Matrix::zeros(rows, cols, Layout::candidates(rows)[0])?;
        let layout = red.choose_layout(&blas);
        let other = || {
            let mut matrix = Matrix::zeros(rows, cols, layout)?;
            matrix.fill_made_up();
            std::io::Result::Ok(matrix)
        };
        let channels = [red, other()?, other()?];
        Ok(Dense {
            blas,
            channels,
            layout,
            patches,
            has_sun,
            weights: vec![0.0; cols],
            linear: [0, 1, 2].map(|_| vec![0.0; rows]),
            kernel: Kernel::detect(),
            covered,
            framebuffer: vec![0; picture_px],
        })
    }

    /// Bytes that the three channels take.
    pub fn bytes(pixels: usize, patches: usize, has_sun: bool) -> usize {
        3 * Matrix::bytes(pixels, patches + usize::from(has_sun))
    }

    /// One line about kernel and layout, for the log.
    pub fn describe(&self) -> String {
        let rows = self.covered.len();
        format!("OpenBLAS kernel {}, layout: {}", self.blas.kernel(), self.layout.name(rows))
    }

    /// Sets the response of the covered pixels to a patch, or to the sun at `patches`.
    pub fn set_column(&mut self, col: usize, response: &[[f32; 3]]) {
        for (c, matrix) in self.channels.iter_mut().enumerate() {
            matrix.set_column(col, response.iter().map(|rgb| rgb[c]));
        }
    }

    fn sum(&mut self, sky: &BenchSky, scale: f32) {
        for c in 0..3 {
            for (weight, rgb) in self.weights.iter_mut().zip(&sky.weights.radiance) {
                *weight = rgb[c] * scale;
            }
            if self.has_sun {
                self.weights[self.patches] = sky.weights.sun.map_or(0.0, |sun| sun.irradiance[c] * scale);
            }
            self.channels[c].multiply(&self.blas, &self.weights, &mut self.linear[c]);
        }
    }

    fn tone(&mut self) {
        let mut linear = [[0f32; STRIP]; 3];
        let mut shown = [0u32; STRIP];
        for (strip, places) in self.covered.chunks(STRIP).enumerate() {
            for (plane, values) in linear.iter_mut().zip(&self.linear) {
                let values = &values[strip * STRIP..][..places.len()];
                plane[..values.len()].copy_from_slice(values);
            }
            self.kernel.tone([&linear[0], &linear[1], &linear[2]], &mut shown);
            for (&at, &word) in places.iter().zip(&shown) {
                if let Some(pixel) = self.framebuffer.get_mut(at as usize) {
                    *pixel = word;
                }
            }
        }
    }
}

/// Pixels toned at a time, so that they stay in the nearest cache.
const STRIP: usize = 256;

impl Method for Dense {
    fn name(&self) -> &'static str {
        DENSE_NAME
    }

    fn budget(&self) -> Option<String> {
        None
    }

    fn frame(&mut self, sky: &BenchSky) -> anyhow::Result<()> {
        self.sum(sky, sky.exposure);
        self.tone();
        Ok(())
    }

    fn show(&mut self, sky: &BenchSky) -> anyhow::Result<Shown> {
        self.frame(sky)?;
        let codes = self.covered.iter().map(|&at| {
            let [_, r, g, b] = self.framebuffer[at as usize].to_be_bytes();
            [r, g, b]
        });
        let codes = codes.collect();
        self.sum(sky, 1.0);
        let [red, green, blue] = &self.linear;
        let radiance = red.iter().zip(green).zip(blue).map(|((&r, &g), &b)| [r, g, b]).collect();
        Ok(Shown { radiance, codes })
    }
}

#[cfg(test)]
mod tests {
    use super::super::method::{errors, tests::made_up, tests::sky};
    use super::*;
    use crate::weights::SunWeight;

    fn filled(pixels: usize, patches: usize, has_sun: bool) -> Option<Dense> {
        let Ok(blas) = Blas::load() else {
            eprintln!("skipped: no OpenBLAS here");
            return None;
        };
        let covered = (0..pixels as u32).map(|k| 2 * k).collect();
        let mut dense = Dense::new(blas, covered, 2 * pixels, patches, has_sun).unwrap();
        let naive = made_up(pixels, patches);
        for col in 0..patches {
            let column: Vec<[f32; 3]> = (0..pixels).map(|p| [0, 1, 2].map(|c| naive.response[c][p][col])).collect();
            dense.set_column(col, &column);
        }
        Some(dense)
    }

    #[test]
    fn agrees_with_the_f64_sum_in_radiance_and_codes() {
        let Some(mut dense) = filled(301, 32, false) else { return };
        let sky = sky("made up", 32, &made_up(301, 32));
        let found = errors(&mut dense, &[sky]).unwrap()[0];
        assert!(found.rmse < 1e-6 && found.worst_code <= 1 && found.share_off_by_more_than_one == 0.0, "{found:?}");
        assert!(found.bias.iter().all(|b| b.abs() < 1e-6));
    }

    #[test]
    fn the_sun_is_a_column_of_its_own() {
        let Some(mut dense) = filled(40, 16, true) else { return };
        let naive = made_up(40, 16);
        let mut sky = sky("made up", 16, &naive);
        dense.set_column(16, &[[0.5, 0.25, 0.0]; 40]);
        sky.weights.sun = Some(SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [2.0, 4.0, 8.0] });
        let with_sun = naive.sum(&sky.weights.radiance).iter().map(|p| [p[0] + 1.0, p[1] + 1.0, p[2]]).collect();
        sky.exact = Some(with_sun);
        let found = errors(&mut dense, &[sky]).unwrap()[0];
        assert!(found.rmse < 1e-6, "{found:?}");
    }

    /// `cargo test --release -p relume --lib bench::dense -- --ignored --nocapture`
    #[test]
    #[ignore = "takes 640 MB and is a measurement"]
    fn time_at_512x384() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let mut dense = Dense::new(blas, (0..512 * 384).collect(), 512 * 384, 272, false).unwrap();
        let sky = sky("made up", 272, &made_up(4, 272));
        let took = super::super::method::time_one(&mut dense, &sky, 15).unwrap();
        eprintln!("{}: {:.1} ms per frame", dense.describe(), 1e3 * took);
    }
}
