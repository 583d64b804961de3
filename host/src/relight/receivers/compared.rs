//! A view beside the light of its receivers, pixel by pixel, and why that may tell nothing.

use super::{DIMMEST, ReceiverLight, TELLING, whole_pixels};
use crate::view::disagreement::{Compared, Disagreement};
use crate::view::gain::FEWEST;

/// Why a view tells nothing of the receivers in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Untold {
    /// The field has no receivers, or hardly any.
    #[error(
        "the field has {0} pixels that show nothing but receivers; mark the ground as relume = receiver and bake again"
    )]
    Few(usize),
    /// There is no light, or hardly any.
    #[error("it is too dark on the receivers; look again by day")]
    Dark,
    /// The view is black or clipped where it shows them.
    #[error("the view is black or clipped where it shows receivers; correct its exposure and look again")]
    Codes,
}

impl ReceiverLight<'_> {
    /// A view beside its receivers under the newest weights, without the virtual geometry. Like [`ReceiverLight::gain`] it counts
    /// from the last [`ReceiverLight::follow`] on.
    ///
    /// # Errors
    /// [`Untold`], where the view has no gain.
    pub fn disagreement(&mut self, view: &[u32]) -> Result<Disagreement, Untold> {
        let is_lit = |at: usize, pitch: usize| (0..3).all(|channel| self.light[1][at + channel * pitch] > DIMMEST);
        if self.whole.len() < FEWEST {
            return Err(Untold::Few(self.whole.len()));
        }
        if self.whole.iter().filter(|pixel| is_lit(pixel.at, pixel.pitch)).count() < FEWEST {
            return Err(Untold::Dark);
        }
        let gain = self.gain(view).ok_or(Untold::Codes)?;
        Ok(Disagreement::of(gain, &self.compared(view)))
    }

    fn compared(&self, view: &[u32]) -> Compared {
        let mut expected = vec![None; view.len()];
        for pixel in whole_pixels(&self.with, &self.shares, &self.in_front) {
            let light: [f32; 3] = std::array::from_fn(|channel| self.light[1][pixel.at + channel * pixel.pitch]);
            if light.iter().all(|&light| light > DIMMEST) {
                expected[pixel.place] = Some(light.map(|light| light / self.exposure));
            }
        }
        let seen = |word: &u32| {
            let [_, r, g, b] = word.to_be_bytes();
            let tells = [r, g, b].iter().all(|code| TELLING.contains(code));
            tells.then(|| [r, g, b].map(|code| self.tone.linear(code)))
        };
        Compared { width: self.with.field().width(), expected, seen: view.iter().map(seen).collect() }
    }
}
