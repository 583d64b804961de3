//! Relume's per-pixel core: weights -> tile coefficients -> linear pixels -> composited surface.
//!
//! `no_std`, no allocation, no operating system. The host program and the C interface lend it bytes and buffers.
#![cfg_attr(not(any(test, feature = "std")), no_std)]

pub mod apart;
pub mod bounce;
pub mod bouncepoint;
pub mod bound;
pub mod casters;
pub mod coefficients;
pub mod composite;
pub mod direct;
pub mod drawn;
pub mod edge;
pub mod field;
pub mod gloss;
#[cfg(feature = "std")]
pub mod glue;
mod header;
pub mod kernel;
pub mod lens;
pub mod levels;
pub mod minifloat;
pub mod overlay;
pub mod patches;
pub mod pixelpoints;
pub mod receivers;
pub mod relight;
pub mod shade;
pub mod sunlight;
pub mod surface;
pub mod tile;
pub mod tone;
mod vector;
pub mod wayback;
pub mod weights;
