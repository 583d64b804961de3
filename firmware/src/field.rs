//! The field file, version 1, byte by byte, and its one checked constructor.
//!
//! All numbers are little-endian. `Field::new` checks every structure below once over borrowed bytes (a memory map or
//! flash); afterwards no accessor can fail.
//!
//! ```text
//! header, 160 bytes
//!   0  8  magic 89 52 4C 4D 0D 0A 1A 0A   ("\x89RLM\r\n\x1a\n": spoilt by any text-mode copy)
//!   8  u16 version = 1
//!  10  u16 header length = 160
//!  12  u32 number of layers
//!  16  u64 file length
//!  24  u32 width, px            28  u32 height, px
//!  32  u32 tile edge, px = 16   36  u32 patch-set id (PatchSet::id)
//!  40  u16 upper patches        42  u16 lower patches
//!  44  u32 covered pixels
//!  48  f32[3] camera position   60  f32[3] camera target    72  f32[3] camera up   (world, metres)
//!  84  f32 vertical field of view, degrees                  88  f32 north_deg
//!  92  f32 error target, a fraction (relative RMSE)
//!  96  f32 site latitude       100  f32 site longitude      (degrees; NaN: baked for any site)
//! 104  u64 seed                112  u32 most surface hits (0: unlimited)
//! 116  reserved, 0
//! 152  u32 CRC-32 of the layer table                        156  u32 CRC-32 of bytes 0..156
//!
//! layer table at 160: per layer 32 bytes
//!   0  [u8;4] kind   4  u32 flags (bit 0: a reader that does not know the kind must refuse the file)
//!   8  u64 offset (multiple of 64)   16  u64 length   24  u32 CRC-32 of the layer   28  reserved, 0
//!
//! layers of version 1 (an unknown kind without flag bit 0 is passed over)
//!   TILE RESU RESV ROWS   the response: a tile set (below)
//!   COVR                  coverage, u8 per covered pixel, 255 = whole; slots of whole tiles may be left out
//!   CAST CBVH FRGT FRAG   direct sunlight: surfaces, their bounding volumes (casters.rs), and what each pixel sees
//!                         (sunlight.rs); like the next two, read only when the sun moves
//!   GLST GLSS             how what each pixel sees gleams in the sun (gloss.rs); left out by a Lambert field
//!   BPNT BTIL BNCE        indirect sunlight: points where the sun is looked for, and what tiles receive (bounce.rs)
//!   BNDB BNDT             constants of the error bound (bound.rs); may be left out
//!   DIRS                  directions of the patches, where they are listed (patches/listed.rs)
//!   LENS                  the lens of the view (lens.rs); left out by a pinhole's field
//!   CUTS                  how the sky is cut, where a scene asks for its own patches (patches/subdivided.rs)
//!   WAYT WAYD             rows of single patches, read only where the factors do not do (wayback.rs); may be left out
//!   RCVW RCVO             receivers, each layer a field of its own (receivers.rs); left out where there are none
//!   META                  UTF-8 JSON about the bake, for people
//!
//! a tile set: one 64-byte record per tile, tiles row by row
//!   0  [u8;32] mask: bit y*16+x (least significant bit first) is set where the pixel is covered
//!  32  u32 place of U    36  u32 place of V    40  u32 place of the row scales   44  u32 place of coverage
//!         (in units of 16 bytes in RESU, RESV, ROWS, COVR; coverage FFFFFFFF: every pixel of the mask is whole)
//!  48  u16 covered pixels n = bits set in the mask           50  u16 rank r of U, even, 0..=v
//!  52  i8[3] exponent of the row scales, R G B               55  i8[3] exponent of V's scales, R G B
//!  58  u16 rank v of V, even, r..=128                            60  reserved, 0
//!   U     i8, r/2 planes of n' pixel pairs: U[x][2j], U[x][2j+1] at (j*n' + x)*2; n' = n rounded up to 16
//!   V     i8 [3][v][p'], p' = patches rounded up to 16 (filled with 0), then u16 [3][v] scales; the tiles of a block
//!         (2 x 2 tiles, from the top left) share one V: same place, rank and exponents
//!   rows  u16 [3][n'] row scales; their places rise with the tile's number and do not overlap, so that planes with
//!         a value per covered pixel and channel (the sun's response) can share the layout
//!
//! response[x][c][i] = rows[c][x] 2^re[c] * sum_k U[x][k] * V[c][k][i] * scale[c][k] 2^ve[c]
//! ```

use crate::bounce::Bounce;
use crate::bound::Bounds;
pub use crate::header::{CameraRecord, Header, Layer};
use crate::header::{u16_at, u32_at, u64_at};
use crate::patches::{MAX_PATCHES, PatchError, PatchSet};
use crate::receivers::SHARED;
use crate::sunlight::SunSurfaces;
use crate::tile::{TILE_RECORD, TileSet};
use crate::wayback::WayBack;

/// First bytes of every field file.
pub const MAGIC: [u8; 8] = *b"\x89RLM\r\n\x1a\n";
/// The version this reader and `relume-bake` speak.
pub const VERSION: u16 = 1;
/// Length of the header, bytes.
pub const HEADER: usize = 160;
/// Length of one entry of the layer table, bytes.
pub const LAYER_ENTRY: usize = 32;
/// Layers start at multiples of this.
pub const LAYER_ALIGN: usize = 64;
/// Largest width or height, px.
pub const MAX_EDGE: u32 = 16384;
/// Layer flag: a reader that does not know the layer must refuse the file.
pub const LAYER_CRITICAL: u32 = 1;
/// Most layers a file may have.
pub const MAX_LAYERS: u32 = 256;

/// A layer's kind.
pub type LayerKind = [u8; 4];

/// Kinds that this version reads.
pub const KNOWN_LAYERS: [LayerKind; 24] = [
    *b"TILE", *b"RESU", *b"RESV", *b"ROWS", *b"COVR", *b"CAST", *b"CBVH", *b"FRGT", *b"FRAG", *b"BPNT", *b"BTIL",
    *b"BNCE", *b"META", *b"BNDB", *b"BNDT", *b"WAYT", *b"WAYD", *b"DIRS", *b"GLST", *b"GLSS", *b"RCVW", *b"RCVO",
    *b"LENS", *b"CUTS",
];

/// What is wrong with a field; each message says what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldError {
    /// Shorter than a header or than the length it states.
    Truncated {
        /// Bytes that are there.
        have: u64,
        /// Bytes that the file says it has.
        need: u64,
    },
    /// The first bytes are not a field's.
    NotAField,
    /// A version this reader does not know.
    Version(u16),
    /// A checksum does not fit; the kind of the layer, or `None` for the header or layer table.
    Checksum(Option<LayerKind>),
    /// The patch-set id is not the one of the stated counts.
    PatchSet {
        /// Id in the file.
        found: u32,
        /// Id that this program gives that set.
        expected: u32,
    },
    /// The patch counts are outside what this reader does.
    Patches(PatchError),
    /// A layer that must be understood is unknown here.
    UnknownLayer(LayerKind),
    /// A layer that version 1 needs is missing.
    MissingLayer(LayerKind),
    /// Something in the header or a layer contradicts the rest; names the place.
    Invalid(&'static str),
}

impl core::fmt::Display for FieldError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let name = |kind: &LayerKind| [kind[0] as char, kind[1] as char, kind[2] as char, kind[3] as char];
        match self {
            FieldError::Truncated { have, need } => {
                write!(f, "truncated: {have} bytes of {need}; copy the field again")
            }
            FieldError::NotAField => write!(f, "not a Relume field; make one with relume-bake"),
            FieldError::Version(v) => {
                write!(f, "field version {v}, this program reads {VERSION}; use the matching release or bake again")
            }
            FieldError::Checksum(None) => write!(f, "damaged header (checksum); copy the field again"),
            FieldError::Checksum(Some(k)) => {
                let [a, b, c, d] = name(k);
                write!(f, "damaged layer {a}{b}{c}{d} (checksum); copy the field again")
            }
            FieldError::PatchSet { found, expected } => {
                write!(f, "patch set {found:08x} is not known here (expected {expected:08x}); bake the field again")
            }
            FieldError::Patches(e) => write!(f, "patch set: {e}; bake the field again"),
            FieldError::UnknownLayer(k) => {
                let [a, b, c, d] = name(k);
                write!(f, "needs layer {a}{b}{c}{d}, which this program does not know; use a newer release")
            }
            FieldError::MissingLayer(k) => {
                let [a, b, c, d] = name(k);
                write!(f, "layer {a}{b}{c}{d} is missing; bake the field again")
            }
            FieldError::Invalid(what) => write!(f, "invalid {what}; bake the field again"),
        }
    }
}

impl core::error::Error for FieldError {}

/// A checked field over borrowed bytes.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    bytes: &'a [u8],
    header: Header,
    response: TileSet<'a>,
    way_back: WayBack<'a>,
    bounds: Option<Bounds<'a>>,
    sun_surfaces: SunSurfaces<'a>,
    bounce: Bounce<'a>,
    meta: &'a [u8],
}

impl<'a> Field<'a> {
    /// Checks the whole file: header, table, every layer's checksum, every record. Cost: one read of the file.
    ///
    /// # Errors
    /// [`FieldError`], which says what is wrong and what to do.
    pub fn new(bytes: &'a [u8]) -> Result<Self, FieldError> {
        Field::inside(bytes, &[])
    }

    /// The same for a field in a layer of the field `around`, with which it may share [`SHARED`] ones.
    pub(crate) fn inside(bytes: &'a [u8], around: &'a [u8]) -> Result<Self, FieldError> {
        let header = check_header(bytes)?;
        let shared = |kind| if around.is_empty() || !SHARED.contains(&kind) { None } else { find_layer(around, kind) };
        let layer =
            |kind: LayerKind| find_layer(bytes, kind).or_else(|| shared(kind)).ok_or(FieldError::MissingLayer(kind));
        let edge = crate::tile::TILE_PX as u32;
        let tiles = (header.width.div_ceil(edge), header.height.div_ceil(edge));
        let size = (header.width, header.height);
        let patches = header.patches.len();
        if patches > MAX_PATCHES {
            return Err(FieldError::Invalid("patch count"));
        }
        let response = TileSet::check(
            [layer(*b"TILE")?, layer(*b"RESU")?, layer(*b"RESV")?, layer(*b"ROWS")?, layer(*b"COVR")?],
            tiles,
            size,
            patches,
        )?;
        if response.covered() != header.covered as usize {
            return Err(FieldError::Invalid("count of covered pixels"));
        }
        let gloss = match find_layer(bytes, *b"GLST") {
            Some(places) => Some([places, layer(*b"GLSS")?]),
            None => None,
        };
        let surfaces = [layer(*b"CAST")?, layer(*b"CBVH")?, layer(*b"FRGT")?, layer(*b"FRAG")?];
        let sun_surfaces = SunSurfaces::check(surfaces, gloss, &response)?;
        let bounce = Bounce::check([layer(*b"BPNT")?, layer(*b"BTIL")?, layer(*b"BNCE")?], &response)?;
        let way_back = match (find_layer(bytes, *b"WAYT"), find_layer(bytes, *b"WAYD")) {
            (Some(places), Some(blocks)) => WayBack::check(places, blocks, &response)?,
            _ => WayBack::NONE,
        };
        let bounds = match (find_layer(bytes, *b"BNDB"), find_layer(bytes, *b"BNDT")) {
            (Some(basis), Some(records)) => Some(Bounds::check(basis, records, response.blocks(), patches)?),
            _ => None,
        };
        let meta = find_layer(bytes, *b"META").unwrap_or(&[]);
        Ok(Field { bytes, header, response, way_back, bounds, sun_surfaces, bounce, meta })
    }

    /// The header's facts.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Picture width, px.
    pub fn width(&self) -> usize {
        self.header.width as usize
    }

    /// Picture height, px.
    pub fn height(&self) -> usize {
        self.header.height as usize
    }

    /// The patch set of the response.
    pub fn patch_set(&self) -> &PatchSet {
        &self.header.patches
    }

    /// The viewpoint.
    pub fn camera(&self) -> &CameraRecord {
        &self.header.camera
    }

    /// The response to the patches.
    pub fn response(&self) -> TileSet<'a> {
        self.response
    }

    /// Rows of single patches, for light that the factors are not good enough for.
    pub fn way_back(&self) -> WayBack<'a> {
        self.way_back
    }

    /// Constants of the error bound, if the file has them.
    pub fn bounds(&self) -> Option<Bounds<'a>> {
        self.bounds
    }

    /// Surfaces for the direct part of the response to the sun.
    pub fn sun_surfaces(&self) -> SunSurfaces<'a> {
        self.sun_surfaces
    }

    /// Points and tiles for the indirect part of the response to the sun.
    pub fn bounce(&self) -> Bounce<'a> {
        self.bounce
    }

    /// Does the field carry what sunlight from any direction needs? If not, the patches around a sun have to stand for it
    /// ([`crate::patches::add_sun`]).
    pub fn answers_sun(&self) -> bool {
        !self.sun_surfaces.casters().is_empty()
    }

    /// Coverage of the tile's covered pixels in mask order, 255 = whole; `None` where all are whole.
    pub fn coverage(&self, tile: usize) -> Option<&'a [u8]> {
        self.response.tile(tile).coverage
    }

    /// What the bake wrote about itself: UTF-8 JSON, empty if none.
    pub fn meta(&self) -> &'a [u8] {
        self.meta
    }

    /// Entries of the layer table, unknown ones included.
    pub fn layers(&self) -> impl Iterator<Item = Layer> + 'a {
        layer_table(self.bytes).chunks_exact(LAYER_ENTRY).map(Layer::decode)
    }

    /// The file.
    pub(crate) fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Length of the file, bytes.
    pub fn file_bytes(&self) -> usize {
        self.bytes.len()
    }
}

fn layer_table(bytes: &[u8]) -> &[u8] {
    &bytes[HEADER..HEADER + u32_at(bytes, 12) as usize * LAYER_ENTRY]
}

pub(crate) fn find_layer(bytes: &[u8], kind: LayerKind) -> Option<&[u8]> {
    let entry = layer_table(bytes).chunks_exact(LAYER_ENTRY).map(Layer::decode).find(|l| l.kind == kind)?;
    bytes.get(entry.offset as usize..(entry.offset + entry.length) as usize)
}

fn check_header(bytes: &[u8]) -> Result<Header, FieldError> {
    let have = bytes.len() as u64;
    if bytes.len() < MAGIC.len() || bytes[..MAGIC.len()] != MAGIC {
        return Err(FieldError::NotAField);
    }
    if bytes.len() < HEADER {
        return Err(FieldError::Truncated { have, need: HEADER as u64 });
    }
    if u16_at(bytes, 8) != VERSION {
        return Err(FieldError::Version(u16_at(bytes, 8)));
    }
    if crc32fast::hash(&bytes[..156]) != u32_at(bytes, 156) || usize::from(u16_at(bytes, 10)) != HEADER {
        return Err(FieldError::Checksum(None));
    }
    let need = u64_at(bytes, 16);
    if have < need {
        return Err(FieldError::Truncated { have, need });
    }
    let layers = u32_at(bytes, 12);
    if layers > MAX_LAYERS || have != need || have < (HEADER + layers as usize * LAYER_ENTRY) as u64 {
        return Err(FieldError::Invalid("length"));
    }
    if crc32fast::hash(layer_table(bytes)) != u32_at(bytes, 152) {
        return Err(FieldError::Checksum(None));
    }
    for layer in layer_table(bytes).chunks_exact(LAYER_ENTRY).map(Layer::decode) {
        check_layer(bytes, &layer)?;
    }
    let layer = |kind| find_layer(bytes, kind);
    Header::decode(bytes, [layer(*b"DIRS"), layer(*b"CUTS")], layer(*b"LENS"))
}

fn check_layer(bytes: &[u8], layer: &Layer) -> Result<(), FieldError> {
    let end = layer.offset.checked_add(layer.length).filter(|&end| end <= bytes.len() as u64);
    let Some(end) = end.filter(|_| layer.offset.is_multiple_of(LAYER_ALIGN as u64)) else {
        return Err(FieldError::Invalid("layer table"));
    };
    if !KNOWN_LAYERS.contains(&layer.kind) {
        let critical = layer.flags & LAYER_CRITICAL != 0;
        return if critical { Err(FieldError::UnknownLayer(layer.kind)) } else { Ok(()) };
    }
    if crc32fast::hash(&bytes[layer.offset as usize..end as usize]) != layer.crc32 {
        return Err(FieldError::Checksum(Some(layer.kind)));
    }
    Ok(())
}

const _: () = assert!(TILE_RECORD == 64);
