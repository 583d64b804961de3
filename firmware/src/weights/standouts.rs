//! Patches that outshine the sky.

use crate::patches::MAX_PATCHES;

/// Most patches that [`standouts`] names.
pub const MAX_STANDOUTS: usize = 8;
/// A patch stands out when it is this many times as bright as the patches' mean.
pub const STANDOUT_TIMES_MEAN: f32 = 4.0;

/// Patches that outshine the sky: brighter than [`STANDOUT_TIMES_MEAN`] times the mean, at most [`MAX_STANDOUTS`],
/// ascending. Returns how many of `out` were written.
pub fn standouts(radiance_linear: &[[f32; 3]], out: &mut [u16; MAX_STANDOUTS]) -> usize {
    let bright = |rgb: &[f32; 3]| rgb[0].max(rgb[1]).max(rgb[2]);
    let mean = radiance_linear.iter().map(|rgb| f64::from(bright(rgb))).sum::<f64>();
    let least = f64::from(STANDOUT_TIMES_MEAN) * mean / radiance_linear.len().max(1) as f64;
    let mut found = [(0.0f32, 0u16); MAX_STANDOUTS];
    let mut count = 0;
    for (patch, rgb) in radiance_linear.iter().enumerate().take(MAX_PATCHES) {
        let own = bright(rgb);
        if f64::from(own) <= least {
            continue;
        }
        let at = found[..count].iter().position(|&(other, _)| other < own).unwrap_or(count);
        if at < MAX_STANDOUTS {
            let last = count.min(MAX_STANDOUTS - 1);
            found.copy_within(at..last, at + 1);
            found[at] = (own, patch as u16);
            count = last + 1;
        }
    }
    found[..count].sort_unstable_by_key(|&(_, patch)| patch);
    out.iter_mut().zip(found).for_each(|(out, (_, patch))| *out = patch);
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_brightest_patches_stand_out() {
        let mut sky = [[1.0; 3]; 64];
        let mut found = [0u16; MAX_STANDOUTS];
        assert_eq!(standouts(&sky, &mut found), 0);
        for (k, patch) in [5usize, 60, 0, 33, 12, 50, 20, 21, 22, 23].into_iter().enumerate() {
            sky[patch] = [100.0 + 10.0 * (k % 5) as f32; 3];
        }
        assert_eq!(standouts(&sky, &mut found), 8);
        assert_eq!(found, [0, 12, 20, 21, 22, 23, 33, 60]);
    }
}
