//! Relume at the post: sky camera -> radiance map -> weights -> pixels -> display.
pub mod plot;
