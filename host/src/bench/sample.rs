//! The pixels that the rivals sum: all covered ones, or evenly spread stretches where a dense response is too large.

/// Covered pixels, and what their time has to be multiplied by.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Their places in the picture, ascending.
    pub places: Vec<u32>,
    /// Their numbers among all covered pixels.
    pub indices: Vec<u32>,
    /// Covered pixels / sampled ones.
    pub scale: f64,
}

/// Pixels of a stretch.
const STRETCH: usize = 2048;

impl Sample {
    /// At most `most` of the covered pixels (all, if they are no more), in whole stretches as far as possible.
    pub fn of(covered: &[u32], most: usize) -> Self {
        let every = covered.len().div_ceil(most.max(1)).max(1);
        let chosen = |index: &usize| (index / STRETCH).is_multiple_of(every);
        let mut indices: Vec<u32> = (0..covered.len()).filter(chosen).map(|index| index as u32).collect();
        indices.truncate(most.max(1));
        let places: Vec<u32> = indices.iter().map(|&index| covered[index as usize]).collect();
        let scale = covered.len() as f64 / places.len().max(1) as f64;
        Sample { places, indices, scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_pixels_are_all_taken() {
        let covered: Vec<u32> = (0..5000).map(|k| 3 * k).collect();
        let sample = Sample::of(&covered, 5000);
        assert_eq!((sample.places, sample.scale), (covered, 1.0));
    }

    #[test]
    fn a_sample_is_spread_and_scaled() {
        let covered: Vec<u32> = (0..40_960).map(|k| k + 7).collect();
        let sample = Sample::of(&covered, 15_000);
        assert!(sample.places.len() <= 15_000 && sample.places.len() > 10_000);
        assert!(sample.places.iter().zip(&sample.indices).all(|(&at, &index)| at == index + 7));
        assert!(*sample.indices.last().unwrap() > 36_000);
        assert!((sample.scale * sample.places.len() as f64 - 40_960.0).abs() < 1e-6);
    }
}
