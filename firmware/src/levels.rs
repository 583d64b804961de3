//! The way back in levels: how many patches are shown by their own rows instead of through the factors.

use crate::patches::MAX_PATCHES;
use crate::weights::{MAX_STANDOUTS, standouts};

/// Levels there are.
pub const LEVELS: usize = 4;
/// Most patches apart per level; level 0 sets apart only what outshines the sky.
const PATCHES_APART: [usize; LEVELS] = [MAX_STANDOUTS, 24, 96, MAX_PATCHES];
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

/// The patches that a level sets apart under this light; how many of `out` were written.
pub fn apart(level: usize, radiance_linear: &[[f32; 3]], out: &mut [u16; MAX_PATCHES]) -> usize {
    if level == 0 {
        let mut brightest = [0u16; MAX_STANDOUTS];
        let count = standouts(radiance_linear, &mut brightest);
        out[..count].copy_from_slice(&brightest[..count]);
        return count;
    }
    let bright = |patch: u16| radiance_linear[usize::from(patch)].into_iter().fold(0.0, f32::max);
    let mut lit = 0;
    for patch in (0..radiance_linear.len().min(MAX_PATCHES) as u16).filter(|&patch| bright(patch) > 0.0) {
        out[lit] = patch;
        lit += 1;
    }
    out[..lit].sort_unstable_by(|&a, &b| bright(b).total_cmp(&bright(a)).then(a.cmp(&b)));
    lit.min(PATCHES_APART[level])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn higher_levels_set_the_brightest_lit_patches_apart() {
        let mut sky = [[0.0f32; 3]; 120];
        (0..110).for_each(|patch| sky[patch] = [0.5, 1.0 + (patch * 37 % 110) as f32, 0.0]);
        let mut out = [0; MAX_PATCHES];
        assert_eq!(apart(0, &sky, &mut out), 0, "nothing outshines the sky");
        for (level, count) in [(1, 24), (2, 96), (3, 110)] {
            assert_eq!(apart(level, &sky, &mut out), count);
            let light = |k: usize| sky[usize::from(out[k])][1];
            assert!((1..count).all(|k| light(k - 1) > light(k)) && light(0) == 110.0);
        }
    }

    #[test]
    fn budgets_are_more_than_rounding() {
        assert!([0.56, 2.0, f32::INFINITY].iter().all(|&codes| is_error_budget(codes)));
        assert!(![0.55, 0.0, -1.0, f32::NAN].iter().any(|&codes| is_error_budget(codes)));
        assert!(may_be_lower(0.9, 2.0) && !may_be_lower(1.0, 2.0));
    }
}
