//! The field file's header and layer table as numbers (layout: field.rs).

use crate::field::{FieldError, HEADER, LAYER_ENTRY, LayerKind, MAGIC, MAX_EDGE, VERSION};
use crate::lens::Lens;
use crate::patches::{Listed, PatchSet, Subdivided};

/// The viewpoint a field was baked for (the camera file's values).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRecord {
    /// Eye, world metres.
    pub position: [f32; 3],
    /// A point in the middle of the picture, or on the lens's axis, world metres.
    pub target: [f32; 3],
    /// World direction that is up in the picture.
    pub up: [f32; 3],
    /// Vertical field of view, degrees; with a lens, that of a pinhole of its focal length.
    pub fov_y_deg: f32,
    /// Where true north lies, degrees from -Z towards +X.
    pub north_deg: f32,
    /// The lens over the field's pixels; none: a pinhole.
    pub lens: Option<Lens>,
}

/// What the header says; `encode` and `decode` are each other's inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// Picture width, px.
    pub width: u32,
    /// Picture height, px.
    pub height: u32,
    /// The patch set.
    pub patches: PatchSet,
    /// Pixels with coverage.
    pub covered: u32,
    /// Viewpoint.
    pub camera: CameraRecord,
    /// Relative RMSE the compression aimed at, a fraction.
    pub error_target: f32,
    /// Latitude and longitude whose sun band was baked, degrees; `None`: any.
    pub site: Option<[f32; 2]>,
    /// Seed of the bake.
    pub seed: u64,
    /// Most surface hits of a path, 0 for unlimited.
    pub max_hits: u32,
}

/// One entry of the layer table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Kind.
    pub kind: LayerKind,
    /// Flags; see [`LAYER_CRITICAL`].
    pub flags: u32,
    /// First byte in the file.
    pub offset: u64,
    /// Length, bytes.
    pub length: u64,
    /// CRC-32 of the layer's bytes.
    pub crc32: u32,
}

#[inline(always)]
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

#[inline(always)]
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

#[inline(always)]
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

#[inline(always)]
pub(crate) fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

#[inline(always)]
pub(crate) fn vec3_at(bytes: &[u8], at: usize) -> [f32; 3] {
    [f32_at(bytes, at), f32_at(bytes, at + 4), f32_at(bytes, at + 8)]
}

impl Header {
    /// The 160 header bytes, checksums included, for a file of `file_length` bytes with this layer table.
    pub fn encode(&self, file_length: u64, layer_table: &[u8]) -> [u8; HEADER] {
        let mut out = [0u8; HEADER];
        let mut put = |at: usize, bytes: &[u8]| out[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &MAGIC);
        put(8, &VERSION.to_le_bytes());
        put(10, &(HEADER as u16).to_le_bytes());
        put(12, &((layer_table.len() / LAYER_ENTRY) as u32).to_le_bytes());
        put(16, &file_length.to_le_bytes());
        put(24, &self.width.to_le_bytes());
        put(28, &self.height.to_le_bytes());
        put(32, &(crate::tile::TILE_PX as u32).to_le_bytes());
        put(36, &self.patches.id().to_le_bytes());
        put(40, &(self.patches.upper() as u16).to_le_bytes());
        put(42, &(self.patches.lower() as u16).to_le_bytes());
        put(44, &self.covered.to_le_bytes());
        let c = &self.camera;
        let floats = c.position.iter().chain(&c.target).chain(&c.up).chain([&c.fov_y_deg, &c.north_deg]);
        for (k, value) in floats.enumerate() {
            put(48 + 4 * k, &value.to_le_bytes());
        }
        put(92, &self.error_target.to_le_bytes());
        let site = self.site.unwrap_or([f32::NAN; 2]);
        put(96, &site[0].to_le_bytes());
        put(100, &site[1].to_le_bytes());
        put(104, &self.seed.to_le_bytes());
        put(112, &self.max_hits.to_le_bytes());
        put(152, &crc32fast::hash(layer_table).to_le_bytes());
        let crc = crc32fast::hash(&out[..156]);
        out[156..].copy_from_slice(&crc.to_le_bytes());
        out
    }

    /// `directions`, `cuts` and `lens` are the layers DIRS, CUTS and LENS, where there are such.
    pub(crate) fn decode(
        b: &[u8],
        [directions, cuts]: [Option<&[u8]>; 2],
        lens: Option<&[u8]>,
    ) -> Result<Self, FieldError> {
        let (width, height) = (u32_at(b, 24), u32_at(b, 28));
        if width == 0 || height == 0 || width > MAX_EDGE || height > MAX_EDGE {
            return Err(FieldError::Invalid("picture size"));
        }
        if u32_at(b, 32) as usize != crate::tile::TILE_PX {
            return Err(FieldError::Invalid("tile size"));
        }
        let counts = [u16_at(b, 40), u16_at(b, 42)].map(usize::from);
        let patches = match (directions, cuts) {
            (Some(list), None) => {
                PatchSet::of_list(Listed::decode(list).ok_or(FieldError::Invalid("list of directions"))?)
            }
            (None, Some(cuts)) => {
                PatchSet::of_subdivided(Subdivided::decode(cuts).ok_or(FieldError::Invalid("cuts of the sky"))?)
            }
            (None, None) => PatchSet::of_counts(counts[0], counts[1]).map_err(FieldError::Patches)?,
            (Some(_), Some(_)) => return Err(FieldError::Invalid("patches, which are listed and cut both")),
        };
        if counts != [patches.upper(), patches.lower()] || patches.id() != u32_at(b, 36) {
            return Err(FieldError::PatchSet { found: u32_at(b, 36), expected: patches.id() });
        }
        let camera = CameraRecord {
            position: vec3_at(b, 48),
            target: vec3_at(b, 60),
            up: vec3_at(b, 72),
            fov_y_deg: f32_at(b, 84),
            north_deg: f32_at(b, 88),
            lens: lens.map(|layer| Lens::decode(layer).ok_or(FieldError::Invalid("lens"))).transpose()?,
        };
        let finite = (48..92).step_by(4).all(|at| f32_at(b, at).is_finite());
        if !(finite && camera.fov_y_deg > 0.0 && camera.fov_y_deg < 180.0) {
            return Err(FieldError::Invalid("camera"));
        }
        let site = [f32_at(b, 96), f32_at(b, 100)];
        Ok(Header {
            width,
            height,
            patches,
            covered: u32_at(b, 44),
            camera,
            error_target: f32_at(b, 92),
            site: (site[0].is_finite() && site[1].is_finite()).then_some(site),
            seed: u64_at(b, 104),
            max_hits: u32_at(b, 112),
        })
    }
}

impl Layer {
    /// The entry's 32 bytes.
    pub fn encode(&self) -> [u8; LAYER_ENTRY] {
        let mut out = [0u8; LAYER_ENTRY];
        out[..4].copy_from_slice(&self.kind);
        out[4..8].copy_from_slice(&self.flags.to_le_bytes());
        out[8..16].copy_from_slice(&self.offset.to_le_bytes());
        out[16..24].copy_from_slice(&self.length.to_le_bytes());
        out[24..28].copy_from_slice(&self.crc32.to_le_bytes());
        out
    }

    pub(crate) fn decode(b: &[u8]) -> Self {
        Layer {
            kind: [b[0], b[1], b[2], b[3]],
            flags: u32_at(b, 4),
            offset: u64_at(b, 8),
            length: u64_at(b, 16),
            crc32: u32_at(b, 24),
        }
    }
}
