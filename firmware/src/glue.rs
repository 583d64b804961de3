//! What both command-line tools need of an operating system (feature `std`).

pub mod failure;
pub mod outfile;
