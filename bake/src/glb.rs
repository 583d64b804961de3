//! Binary glTF 2.0 files: the binary part with its views and accessors, and the container.

use serde_json::{Value, json};

/// `componentType` of single precision (glTF 2.0, section 3.6.2.2).
pub const FLOAT: u32 = 5126;
/// That of 32-bit indices.
pub const UINT: u32 = 5125;

/// The binary part, its views and accessors while they grow.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// What the views lie in.
    pub binary: Vec<u8>,
    /// `bufferViews`.
    pub views: Vec<Value>,
    /// `accessors`.
    pub accessors: Vec<Value>,
}

impl Parts {
    /// Adds a view; its index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()}));
        self.binary.extend_from_slice(bytes);
        pad(&mut self.binary, 0);
        self.views.len() - 1
    }

    /// Adds `count` elements of a `kind` (`VEC3`) of components; the least and largest where they are stated. Its index.
    pub fn accessor(
        &mut self,
        bytes: &[u8],
        count: usize,
        component: u32,
        kind: &str,
        bounds: Option<(Value, Value)>,
    ) -> usize {
        let view = self.view(bytes);
        let mut accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        if let Some((min, max)) = bounds {
            (accessor["min"], accessor["max"]) = (min, max);
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

fn pad(bytes: &mut Vec<u8>, fill: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), fill);
}

/// Header and chunks (glTF 2.0, section 4.4); without a binary part there is no chunk for it.
pub fn container(root: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    pad(&mut json, b' ');
    let mut file = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    let chunks: [(&[u8; 4], &[u8]); 2] = [(b"JSON", &json), (b"BIN\0", binary)];
    for (kind, bytes) in chunks.into_iter().filter(|(_, bytes)| !bytes.is_empty()) {
        file.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
        file.extend_from_slice(kind);
        file.extend_from_slice(bytes);
    }
    let length = file.len() as u32;
    file[8..12].copy_from_slice(&length.to_le_bytes());
    file
}
