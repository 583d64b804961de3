//! Pictures that others made, one per light -> field.
//!
//! A picture shows the object under one distant light of irradiance `E` on a plane that faces it. Its patch stands for a
//! solid angle `w`, so what the object shows when that patch alone has radiance 1 is the picture times `w / E`. Pictures
//! are read once and spooled, block by block, to a file without a name beside the output; then the blocks are compressed as
//! those of a bake. In memory are one picture per thread (some 20 bytes per pixel), the field that grows, and the exact
//! sums that its errors are told by.

mod cells;
mod compression;
mod fault;
mod lightdome;
mod manifest;
mod mask;
mod patches;
mod picture;
mod radiance;
mod source;
mod spool;

pub use compression::{ImportOptions, import};
pub use fault::ImportError;
pub use picture::Encoding;
pub use source::{LightPicture, Side, Source};
