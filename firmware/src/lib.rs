//! Relume's per-pixel core.
#![no_std]
pub mod patches;
