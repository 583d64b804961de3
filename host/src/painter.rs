//! Weights into the picture shown: what the loop needs from a field, and nothing else.

pub mod field;

use crate::damage::Damage;
use crate::relight::FrameCounters;
use crate::view::gain::ViewGain;
use crate::weights::PatchWeights;
use relume_firmware::patches::PatchSet;

/// Turns weights into the picture shown.
pub trait Painter {
    /// Width and height in pixels.
    fn size(&self) -> (usize, usize);

    /// The patches that weights must be given for.
    fn patch_set(&self) -> PatchSet;

    /// Where north lies, degrees from -Z towards +X.
    fn north_deg(&self) -> f64;

    /// Takes new weights and an exposure factor; returns what should be known, such as a sun moved into the site's band.
    ///
    /// # Errors
    /// When the weights do not fit; the picture stays as it was.
    fn relight(&mut self, weights: &PatchWeights, exposure: f32) -> anyhow::Result<Option<String>>;

    /// The direction of the sun whose light is shown; it may lag behind the newest weights'. `None` where none is shown.
    fn sun_dir_world(&self) -> Option<[f32; 3]> {
        None
    }

    /// Keeps to the sun that is shown, whatever was traced meanwhile, until this is lifted.
    fn hold_sun(&mut self, _is_held: bool) {}

    /// Is there work done behind frames (a traced sun) that relighting the same weights would show?
    fn has_news(&mut self) -> bool {
        false
    }

    /// The exposure that the picture of the newest weights asks for; `None` in the dark.
    fn wanted_exposure(&mut self) -> Option<f64>;

    /// How the view shows receivers in the newest weights; `None` where it shows none.
    fn view_gain(&mut self) -> Option<ViewGain> {
        None
    }

    /// Draws what changed, and marks it; the counters tell what that was.
    ///
    /// # Errors
    /// When drawing is not possible at all.
    fn draw(&mut self, damage: &mut Damage) -> anyhow::Result<FrameCounters>;

    /// Puts another view behind the picture from the next [`Painter::draw`] on: exchanges the pixels in use (`0x00RRGGBB`) for
    /// `pixels_bgrx`. Painters without a view leave them.
    fn show_view(&mut self, _pixels_bgrx: &mut Vec<u32>) {}

    /// The view behind, `0x00RRGGBB`; nothing without one.
    fn view_bgrx(&self) -> &[u32] {
        &[]
    }

    /// The whole picture, `0x00RRGGBB`, as last drawn.
    fn pixels_bgrx(&self) -> &[u32];
}
