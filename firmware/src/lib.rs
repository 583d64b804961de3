//! Relume's per-pixel core: weights -> tile coefficients -> linear pixels -> composited surface.
//!
//! `no_std`, no allocation, no operating system. The host program and the C interface lend it bytes and buffers.
#![cfg_attr(not(any(test, feature = "std")), no_std)]

pub mod bound;
pub mod coefficients;
pub mod composite;
pub mod field;
#[cfg(feature = "std")]
pub mod glue;
mod header;
pub mod interpolate;
pub mod kernel;
pub mod overlay;
pub mod patches;
pub mod relight;
pub mod sunlight;
pub mod surface;
pub mod tile;
pub mod tone;
pub mod wayback;
pub mod weights;
