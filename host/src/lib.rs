//! Relume at the post: sky camera -> radiance map -> weights -> pixels -> display.
pub mod bench;
pub mod plot;
pub mod map;
pub mod split;
pub mod sun;
pub mod weights;
pub mod display;
pub mod exposure;
pub mod failure;
pub mod outfile;
pub mod picture;
pub mod view;
