//! The coverage of imported pictures: a mask, or the first picture's alpha.

use super::fault::ImportError;
use super::picture::{Encoding, Picture};
use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
use std::path::Path;

/// Share of each pixel that shows the object, `[y][x]`: from an EXR with one channel, else from the alpha of `file`, else
/// from its green, linear.
///
/// # Errors
/// [`ImportError`] when it cannot be read.
pub(super) fn read(file: &Path, shrink: usize) -> Result<((usize, usize), Vec<f32>), ImportError> {
    let picture = match lone_channel(file) {
        Some((size, alpha)) => {
            Picture { size, rgb: vec![0.0; 3 * alpha.len()], alpha: Some(alpha), premultiplied: true }
        }
        None => Picture::read(file, Some(Encoding::Linear))?,
    };
    let picture = picture.shrunk(shrink);
    let share = match picture.alpha {
        Some(alpha) => alpha,
        None => picture.rgb.iter().skip(1).step_by(3).copied().collect(),
    };
    if share.iter().any(|share| !share.is_finite()) {
        return Err(ImportError::file(file, "the mask holds values that are not finite"));
    }
    Ok((picture.size, share.into_iter().map(|share| share.clamp(0.0, 1.0)).collect()))
}

/// The only channel of an EXR that has one.
fn lone_channel(file: &Path) -> Option<((usize, usize), Vec<f32>)> {
    let layer = read_first_flat_layer_from_file(file).ok()?.layer_data;
    let size = (layer.size.width(), layer.size.height());
    let mut channels = layer.channel_data.list.into_iter();
    match (channels.next()?.sample_data, channels.next()) {
        (FlatSamples::F32(share), None) => Some((size, share)),
        (FlatSamples::F16(share), None) => Some((size, share.into_iter().map(f32::from).collect())),
        _ => None,
    }
}
