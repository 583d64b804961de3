//! Reads numbers out of glTF accessors without trusting a single offset of the file.

use gltf::Accessor;
use gltf::accessor::{DataType, sparse::IndexType};

/// Most elements that one accessor may have; more is a broken file, not a scene.
const MAX_ELEMENTS: usize = 1 << 28;

fn component_size(kind: DataType) -> usize {
    match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

/// One component as a number; integers are scaled to -1..1 or 0..1 when `normalized` (glTF 2.0, 3.6.2.2).
fn component(bytes: &[u8], kind: DataType, normalized: bool) -> Option<f64> {
    let (value, scale) = match kind {
        DataType::I8 => (f64::from(i8::from_le_bytes(bytes.try_into().ok()?)), 127.0),
        DataType::U8 => (f64::from(*bytes.first()?), 255.0),
        DataType::I16 => (f64::from(i16::from_le_bytes(bytes.try_into().ok()?)), 32767.0),
        DataType::U16 => (f64::from(u16::from_le_bytes(bytes.try_into().ok()?)), 65535.0),
        DataType::U32 => (f64::from(u32::from_le_bytes(bytes.try_into().ok()?)), 4_294_967_295.0),
        DataType::F32 => return Some(f64::from(f32::from_le_bytes(bytes.try_into().ok()?))),
    };
    Some(if normalized { (value / scale).max(-1.0) } else { value })
}

/// A run of equally spaced elements inside a buffer.
struct Strided<'b> {
    bytes: &'b [u8],
    stride: usize,
    offset: usize,
}

impl<'b> Strided<'b> {
    fn new(view: &gltf::buffer::View, offset: usize, packed: usize, buffers: &'b [Vec<u8>]) -> Option<Self> {
        let buffer = buffers.get(view.buffer().index())?;
        let end = view.offset().checked_add(view.length())?;
        Some(Strided { bytes: buffer.get(view.offset()..end)?, stride: view.stride().unwrap_or(packed), offset })
    }

    fn element(&self, index: usize, size: usize) -> Option<&'b [u8]> {
        let from = self.offset.checked_add(index.checked_mul(self.stride)?)?;
        self.bytes.get(from..from.checked_add(size)?)
    }
}

/// All elements of `accessor`, `[count][components]`; `None` when they are not where the file says they are.
pub(crate) fn read(accessor: &Accessor, buffers: &[Vec<u8>]) -> Option<(Vec<f64>, usize)> {
    let components = accessor.dimensions().multiplicity();
    let kind = accessor.data_type();
    let size = component_size(kind);
    let count = accessor.count();
    if count > MAX_ELEMENTS {
        return None;
    }
    let decode = |bytes: &[u8], out: &mut [f64]| -> Option<()> {
        for (value, bytes) in out.iter_mut().zip(bytes.chunks_exact(size)) {
            *value = component(bytes, kind, accessor.normalized())?;
        }
        Some(())
    };
    let packed = size * components;
    let base = match accessor.view() {
        Some(view) => {
            let run = Strided::new(&view, accessor.offset(), packed, buffers)?;
            // Before anything is allocated: the last element must exist.
            run.element(count.checked_sub(1)?, packed)?;
            Some(run)
        }
        None => None,
    };
    let mut values = vec![0.0; count.checked_mul(components)?];
    if let Some(run) = base {
        for (index, out) in values.chunks_exact_mut(components).enumerate() {
            decode(run.element(index, packed)?, out)?;
        }
    }
    if let Some(sparse) = accessor.sparse() {
        let index_kind = match sparse.indices().index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let index_size = component_size(index_kind);
        let at = Strided::new(&sparse.indices().view(), sparse.indices().offset(), index_size, buffers)?;
        let from = Strided::new(&sparse.values().view(), sparse.values().offset(), packed, buffers)?;
        for index in 0..sparse.count() {
            let target = component(at.element(index, index_size)?, index_kind, false)? as usize;
            let start = target.checked_mul(components)?;
            let out = values.get_mut(start..start.checked_add(components)?)?;
            decode(from.element(index, packed)?, out)?;
        }
    }
    Some((values, components))
}
