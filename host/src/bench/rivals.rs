//! The rivals of a run, made from one pass over the stack, or from made-up numbers where only time is measured.

use std::sync::Arc;

use relume_firmware::kernel::Kernel;
use relume_firmware::patches::PatchSet;

use super::bandwidth;
use super::columns::{Blocks, Columns, USUAL_BLOCK_PX};
use super::dense::Dense;
use super::int8::Int8;
use super::lights::{LIGHTS, Lights};
use super::method::Method;
use super::openblas::Blas;
use super::pca::{COMPONENTS, Directions, Pca};
use super::rival::{Rival, Summation};
use super::sample::Sample;

/// What all rivals are made of.
pub struct Rivals {
    /// `None`: there is no OpenBLAS here, and only the int8 sum is left.
    blas: Option<Arc<Blas>>,
    dense: Columns,
    patches: usize,
    sample: Arc<Sample>,
    picture_px: usize,
}

impl Rivals {
    /// Takes the memory for the dense response of the covered pixels, or of as many as fit a third of what is available.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn new(covered: &[u32], picture_px: usize, patches: usize, has_sun: bool) -> anyhow::Result<(Self, String)> {
        let cols = patches + usize::from(has_sun);
        let available = bandwidth::available_memory().unwrap_or(usize::MAX);
        // A third, as int8 rows and the components want half as much again.
        let sample = Arc::new(Sample::of(covered, available / 3 / (12 * cols)));
        let pixels = sample.places.len();
        let mut dense = Columns::zeros(Blocks { pixels, cols, block_px: USUAL_BLOCK_PX })?;
        let (blas, mut note) = match Blas::load() {
            Ok(blas) => {
                dense.choose_block_px(&blas);
                let forced =
                    std::env::var("OPENBLAS_CORETYPE").map(|core| format!(", OPENBLAS_CORETYPE={core} is set"));
                // What OpenBLAS takes for a processor newer than itself: rivals would be slower than they are.
                let lost = if blas.kernel() == "Prescott" && Kernel::paths().count() > 1 {
                    "; this OpenBLAS does not know the processor, set OPENBLAS_CORETYPE (Haswell, SkylakeX)"
                } else {
                    ""
                };
                let note = format!(
                    "OpenBLAS kernel {}, blocks of {} px x columns{}{lost}",
                    blas.kernel(),
                    dense.blocks().block_px,
                    forced.unwrap_or_default()
                );
                (Some(Arc::new(blas)), note)
            }
            Err(error) => (None, format!("all that needs OpenBLAS is left out: {error}")),
        };
        if sample.scale > 1.0 {
            note += &format!("; rivals sum a sample of {pixels} of {} covered pixels, scaled", covered.len());
        }
        dense.fill_made_up();
        Ok((Rivals { blas, dense, patches, sample, picture_px }, note))
    }

    /// Sets the response of all covered pixels to a patch, or to the sun behind the patches.
    pub fn set_column(&mut self, col: usize, response: &[[f32; 3]]) {
        let sampled: Vec<[f32; 3]> = self.sample.indices.iter().map(|&index| response[index as usize]).collect();
        self.dense.set_column(col, &sampled);
    }

    /// All of them, the dense sum first; `measured`: the columns were set, so that components are worth finding. What
    /// cannot be made is left out with a line for the log.
    pub fn into_methods(
        self,
        set: &PatchSet,
        pool: &Arc<rayon::ThreadPool>,
        measured: bool,
    ) -> (Vec<Box<dyn Method>>, Vec<String>) {
        let (mut methods, mut notes) = (Vec::new(), Vec::new());
        let mut others: Vec<Box<dyn Method>> = Vec::new();
        match Int8::new(&self.dense, self.patches) {
            Ok(int8) => others.push(self.method(int8, pool)),
            Err(error) => notes.push(format!("the int8 sum is left out: {error}")),
        }
        if let Some(blas) = &self.blas {
            match self.components(blas, pool, measured) {
                Ok(components) => others.extend(components),
                Err(error) => notes.push(format!("global PCA is left out: {error}")),
            }
            for count in LIGHTS {
                let lights = Lights::new(Arc::clone(blas), self.dense.clone(), set, count);
                others.push(self.method(lights, pool));
            }
            let dense = Dense::new(Arc::clone(blas), self.dense.clone(), self.patches);
            methods.push(self.method(dense, pool));
        }
        methods.extend(others);
        (methods, notes)
    }

    fn components(
        &self,
        blas: &Arc<Blas>,
        pool: &Arc<rayon::ThreadPool>,
        measured: bool,
    ) -> anyhow::Result<Vec<Box<dyn Method>>> {
        let (dense, patches) = (&self.dense, self.patches);
        let directions = if measured { Directions::new(blas, dense, patches)? } else { Directions::made_up(patches) };
        let one = |count| Ok(self.method(Pca::new(Arc::clone(blas), dense, patches, &directions, count)?, pool));
        COMPONENTS.into_iter().map(one).collect()
    }

    fn method<S: Summation + 'static>(&self, sum: S, pool: &Arc<rayon::ThreadPool>) -> Box<dyn Method> {
        Box::new(Rival::new(sum, Arc::clone(&self.sample), self.picture_px, Arc::clone(pool)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::method::tests::{Naive, made_up, sky};
    use super::super::method::{BenchSky, errors};
    use super::*;
    use crate::weights::SunWeight;

    const SUN: [f32; 3] = [2.0, 4.0, 8.0];

    /// Every rival over the same made-up response of 5000 pixels, and the sky they are to show, with its exact picture.
    fn all(has_sun: bool) -> (Vec<Box<dyn Method>>, BenchSky) {
        let set = PatchSet::new(16).unwrap();
        let (pixels, patches) = (5000, set.len());
        let naive: Naive = made_up(pixels, patches);
        let covered: Vec<u32> = (0..pixels as u32).map(|k| 2 * k + 1).collect();
        let (mut rivals, _) = Rivals::new(&covered, 2 * pixels, patches, has_sun).unwrap();
        for col in 0..patches {
            let column: Vec<[f32; 3]> = (0..pixels).map(|p| [0, 1, 2].map(|c| naive.response[c][p][col])).collect();
            rivals.set_column(col, &column);
        }
        let mut sky = sky("made up", patches, &naive);
        if has_sun {
            rivals.set_column(patches, &vec![[0.5, 0.25, 0.0]; pixels]);
            sky.weights.sun = Some(SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: SUN });
            let lit = naive.sum(&sky.weights.radiance).iter().map(|p| [p[0] + 1.0, p[1] + 1.0, p[2]]).collect();
            sky.exact = Some(lit);
        }
        let (methods, notes) = rivals.into_methods(&set, &super::super::rival::pool(2).unwrap(), true);
        assert!(notes.is_empty(), "{notes:?}");
        (methods, sky)
    }

    #[test]
    fn all_agree_with_the_f64_sum_as_far_as_their_method_goes() {
        for (has_sun, threads) in [(false, 1), (false, 2), (true, 1), (true, 2)] {
            let (mut methods, sky) = all(has_sun);
            for method in &mut methods {
                method.set_threads(threads);
                let found = errors(method.as_mut(), std::slice::from_ref(&sky)).unwrap()[0];
                let name = format!("{} {:?} {has_sun} {threads}", method.name(), method.budget());
                // All patches and as many components as patches are exact; few components and few lights are nothing
                // of the kind for a response without any smoothness.
                let whole = format!("{} components", sky.weights.radiance.len());
                let limit = match (method.name(), method.budget()) {
                    ("dense_int8", _) => 0.01,
                    (_, None) => 2e-6,
                    (_, Some(budget)) if budget == whole => 2e-6,
                    _ => 0.6,
                };
                assert!(found.rmse < limit, "{name}: {found:?}");
                assert!(limit > 0.01 || found.worst_code <= 2, "{name}: {found:?}");
            }
        }
    }

    #[test]
    fn a_method_that_reads_less_says_so() {
        let (methods, with) = all(true);
        let patches = with.weights.radiance.len();
        let mut without = with.clone();
        without.weights.sun = None;
        let bytes: Vec<usize> = methods.iter().map(|m| m.bytes_read(&without)).collect();
        if methods[0].name() == crate::bench::DENSE_NAME {
            assert_eq!(bytes[0], 5000 * 3 * patches * 4);
            assert_eq!(methods[0].bytes_read(&with), 5000 * 3 * (patches + 1) * 4);
            assert!(bytes[1] < bytes[0]);
        }
    }
}
