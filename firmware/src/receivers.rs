//! Receivers: real surfaces that take the shadow and the reflected light of what is shown.
//!
//! A field with receivers holds two more fields of the same view and patches: what the receivers reflect with the virtual
//! geometry (layer RCVW) and without it (layer RCVO). Their coverage is the share of the pixel that shows a receiver, their
//! radiance premultiplied by it. What a real picture of the receivers has to be multiplied by is the one over the other.

use crate::field::{Field, FieldError, LayerKind, find_layer};
use crate::shade::BRIGHTEST;

/// Layers that RCVW leaves to the field around it: the light meets the same surfaces.
pub const SHARED: [LayerKind; 2] = [*b"CAST", *b"CBVH"];

/// The receivers of a field.
#[derive(Clone, Copy, Debug)]
pub struct Receivers<'a> {
    /// What they reflect with the virtual geometry.
    pub with: Field<'a>,
    /// What they reflect without it.
    pub without: Field<'a>,
}

impl<'a> Receivers<'a> {
    /// The receivers of `field`, checked; `None` if it has none.
    ///
    /// # Errors
    /// [`FieldError`] if one of the layers is no sound field, or not of the same pixels and patches.
    pub fn of(field: &Field<'a>) -> Result<Option<Self>, FieldError> {
        let bytes = field.bytes();
        let (Some(with), Some(without)) = (find_layer(bytes, *b"RCVW"), find_layer(bytes, *b"RCVO")) else {
            return Ok(None);
        };
        let receivers = Receivers { with: Field::inside(with, bytes)?, without: Field::new(without)? };
        for part in [&receivers.with, &receivers.without] {
            let same_size = (part.width(), part.height()) == (field.width(), field.height());
            if !same_size || part.patch_set().id() != field.patch_set().id() {
                return Err(FieldError::Invalid("receivers (size or patches)"));
            }
        }
        let (a, b) = (receivers.with.response(), receivers.without.response());
        let mut tiles = (0..a.tiles()).map(|index| (a.tile(index), b.tile(index)));
        if !tiles.all(|(a, b)| a.covered().eq(b.covered()) && a.coverage == b.coverage) {
            return Err(FieldError::Invalid("receivers (coverage)"));
        }
        Ok(Some(receivers))
    }

    /// Bytes of the two layers.
    pub fn bytes(&self) -> [usize; 2] {
        [self.with.file_bytes(), self.without.file_bytes()]
    }
}

/// Shares of the light of a white surface below which receivers are taken for dark: what is there of it is rounding.
pub const DARKEST: f32 = 1.0 / 2048.0;
/// What the light of a receiver is multiplied by because of the virtual geometry: `share` of it, of linear light `with` and
/// `without` that (1 = what a white surface shows in the open), both premultiplied by the same coverage. Nothing is made of
/// light so weak that it is rounding.
#[inline]
pub fn factor(with: f32, without: f32, share: f32) -> f32 {
    factor_of_still(with, without, share, (1.0, 1.0))
}

/// The same where the view was taken in other light: `without` is that of then, `receiver` the scale from then to now, and
/// `rest` what everything else is multiplied by.
#[inline]
pub fn factor_of_still(with: f32, without: f32, share: f32, (receiver, rest): (f32, f32)) -> f32 {
    let own = receiver * (1.0 + (with - without) / without.max(DARKEST));
    (rest + share * (own - rest)).clamp(0.0, BRIGHTEST)
}

/// The share of a pixel's real part that its receivers are, of coverages in 255ths: what the factor of the receivers concerns
/// of `1 - coverage` of the view.
#[inline]
pub fn share_of_view(receiver: u8, covered: u8) -> f32 {
    let real = 255 - covered;
    if real == 0 { 0.0 } else { (f32::from(receiver) / f32::from(real)).min(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_that_stays_changes_nothing_and_halved_light_halves() {
        assert_eq!(factor(0.3, 0.3, 1.0), 1.0);
        assert!((factor(0.15, 0.3, 1.0) - 0.5).abs() < 1e-6);
        // Half of what is seen of the real world is not the receiver.
        assert!((factor(0.15, 0.3, 0.5) - 0.75).abs() < 1e-6);
        assert!((factor(0.6, 0.3, 1.0) - 2.0).abs() < 1e-6);
        // Rounding in the dark is no light, and a lamp in it no glare.
        assert!((factor(1e-6, 0.0, 1.0) - 1.0).abs() < 0.01);
        assert_eq!(factor(1.0, 0.0, 1.0), BRIGHTEST);
        assert_eq!(factor(-0.5, 0.1, 1.0), 0.0);
    }

    #[test]
    fn a_still_of_a_brighter_day_gets_darker_by_receiver_and_rest() {
        // Then 0.4 at gain 2, now 0.1 at gain 4: half as bright; the sky behind a third.
        assert!((factor_of_still(0.1, 0.4, 1.0, (2.0, 1.0 / 3.0)) - 0.5).abs() < 1e-6);
        assert!((factor_of_still(0.1, 0.4, 0.0, (2.0, 1.0 / 3.0)) - 1.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn what_a_receiver_is_of_the_view_counts_what_is_in_front() {
        assert_eq!([share_of_view(255, 0), share_of_view(128, 127), share_of_view(51, 0)], [1.0, 1.0, 0.2]);
        assert_eq!(share_of_view(0, 255), 0.0);
    }
}
