//! Receivers -> layers of the field that they belong to.

use crate::write::Draft;
use relume_firmware::field::{Field, FieldError, LayerKind};
use relume_firmware::receivers::SHARED;

/// The field of the receivers with the virtual geometry as it lies in the layer RCVW: without the layers that it shares with
/// the field around it.
///
/// # Errors
/// [`FieldError`] if `bytes` are no field.
pub fn nested(bytes: &[u8]) -> Result<Vec<u8>, FieldError> {
    let field = Field::new(bytes)?;
    let own = field.layers().filter(|layer| !SHARED.contains(&layer.kind) && layer.kind != *b"META");
    let layers: Vec<(LayerKind, u32, Vec<u8>)> = own
        .map(|layer| {
            let from = layer.offset as usize;
            (layer.kind, layer.flags, bytes[from..from + layer.length as usize].to_vec())
        })
        .collect();
    Ok(Draft::new(*field.header(), layers).finish(&String::from_utf8_lossy(field.meta())))
}
