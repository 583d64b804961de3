//! The response of one pixel twice over, by independent random numbers from the same surfaces: products of the two are free of
//! the noise that squares of one would have.

use super::Transport;
use crate::strata::Rng;

/// Tells the second random numbers from all others of the pixel.
const SECOND: u32 = 0x005e_c04d;

impl Transport<'_> {
    /// Two responses of pixel (`x`, `y`), `[channel 3][patch]` each, premultiplied; `None` where nothing is seen.
    pub(crate) fn twice(&self, x: u32, y: u32) -> Option<[Vec<f32>; 2]> {
        let (seen, first) = self.seen(x, y);
        seen.iter().any(Option::is_some).then_some(())?;
        let once = |mut rng: Rng| {
            let mut response = vec![0.0; 3 * self.patches.len()];
            let mut indirect = vec![0.0; 3 * self.patches.len()];
            self.further_light(&seen, [&mut response, &mut indirect], &mut rng);
            response.iter_mut().zip(&indirect).for_each(|(all, further)| *all += further);
            self.first_light(&seen, &mut response, &mut rng);
            response
        };
        Some([once(first), once(Rng::new(self.options.seed, x, y, SECOND))])
    }
}
