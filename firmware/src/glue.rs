//! What both command-line tools need beyond the core (feature `std`): exit codes, files that appear whole, radiance maps and
//! the weights they become, cuts of the sky as text, least squares.

mod cells;
pub mod cuts;
pub mod failure;
pub mod least_squares;
pub mod map;
pub mod moments;
pub mod outfile;
mod patchsums;
pub mod split;
pub mod weights;
