//! `relume bench`: time per frame against error on this machine, beside a dense f32 sum by OpenBLAS in the same run.

mod bandwidth;
mod clock;
mod dense;
mod error;
mod facts;
mod figure;
mod matrix;
mod method;
mod openblas;
mod report;
mod skies;
mod sums;

pub use bandwidth::{Bandwidth, available_memory, read_bandwidth};
pub use clock::{cpu_s, median};
pub use dense::Dense;
pub use error::{Errors, Summary, compare, exposure_for, srgb_code, summarise};
pub use facts::{bytes_read, covered};
pub use figure::figure;
pub use method::{BenchSky, Method, Shown, errors, time};
pub use openblas::{Blas, BlasError, LIBRARY_VARIABLE};
pub use report::{BenchReport, DENSE_NAME, MethodReport, RELUME_NAME};
pub use skies::{SAME_SUN_DEG, angle_deg, gather_suns, leave_out_foreign_suns, load_skies};
pub use sums::Sums;
