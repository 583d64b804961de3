//! The way back in levels: how many patches are shown by their own rows instead of through the factors.

use crate::field::Field;
use crate::kernel::Kernel;
use crate::weights::{Apart, EXCESS_TIMES_MEAN, LightApart, MAX_STANDOUTS, MOST_STANDOUTS, standouts};

/// Levels there are.
pub const LEVELS: usize = 4;
/// Most patches that a level below the highest sets part of apart; level 0 only of those that clearly outshine what is
/// expected. The highest sets all light apart.
const STANDOUTS: [usize; LEVELS - 1] = [MAX_STANDOUTS, 24, MOST_STANDOUTS];
/// A block tries a lower level when its bounds are under this share of the error budget: far enough from it that it does
/// not come back with every frame.
const LOWER_SHARE: f32 = 0.5;
/// The least error budget: half a code is rounding's, and the tone curve's own error is in the bound.
const LEAST_CODES: f32 = 0.55;

/// May this be an error budget, in 8-bit codes?
pub fn is_error_budget(codes: f32) -> bool {
    codes > LEAST_CODES
}

/// Is a tile's bound so far below the budget that its block may try a lower level?
pub fn may_be_lower(bound_codes: f32, budget_codes: f32) -> bool {
    bound_codes < LOWER_SHARE * budget_codes
}

/// The light that a level sets apart, in radiance. A field without way back sets nothing apart, one without bounds only on
/// the highest level. `room` is for a list.
pub fn apart<'r>(
    level: usize,
    field: &Field<'_>,
    radiance_linear: &[[f32; 3]],
    kernel: Kernel,
    room: &'r mut [Apart; MOST_STANDOUTS],
) -> LightApart<'r> {
    if field.way_back().bytes() == 0 {
        return LightApart::NONE;
    }
    let Some(&most) = STANDOUTS.get(level) else { return LightApart::All };
    let times_mean = if level == 0 { EXCESS_TIMES_MEAN } else { 0.0 };
    let room = &mut room[..most];
    let count = field.bounds().map_or(0, |bounds| standouts(&bounds, radiance_linear, times_mean, kernel, room));
    LightApart::Some(&room[..count])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_are_more_than_rounding() {
        assert!([0.56, 2.0, f32::INFINITY].iter().all(|&codes| is_error_budget(codes)));
        assert!(![0.55, 0.0, -1.0, f32::NAN].iter().any(|&codes| is_error_budget(codes)));
        assert!(may_be_lower(0.9, 2.0) && !may_be_lower(1.0, 2.0));
    }
}
