//! What the whole-system tests in `tests/tests` share: a small scene made in code, the two programs, and pictures read
//! without the code under test.

pub mod counting;
pub mod directsun;
pub mod files;
pub mod light;
pub mod origins;
pub mod patcherror;
pub mod picture;
pub mod program;
pub mod random;
pub mod receiversite;
pub mod scene;
pub mod skip;
pub mod skycamera;
pub mod slurm;
pub mod stressbound;
pub mod stressfield;
pub mod stresslight;
pub mod symbols;
