//! Numerical stability: lights and responses at the ends of what numbers hold, and the certified bound against the
//! truth. The responses have a closed form; the truth is their sum in f64.

#![allow(clippy::unwrap_used)]

#[path = "stress/bounds.rs"]
mod bounds;
#[path = "stress/changes.rs"]
mod changes;
#[path = "stress/frames.rs"]
mod frames;
#[path = "stress/standouts.rs"]
mod standouts;
#[path = "stress/steps.rs"]
mod steps;
