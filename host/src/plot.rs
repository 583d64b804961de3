//! Small charts and contact sheets as pictures, drawn with `embedded-graphics`.
//!
//! A [`Chart`] has two axes (linear or logarithmic), any number of [`Series`] and a legend. Lines and markers are drawn
//! at [`OVERSAMPLE`] times the size and averaged down; text is drawn afterwards at its own size, so that it stays sharp.
//!
//! ```no_run
//! use relume::plot::{Axis, Chart, Series};
//! let chart = Chart::new("Time against error", Axis::log("CPU ms per frame"), Axis::log("relative RMSE"))
//!     .with(Series::line("relume", vec![(0.4, 0.02), (0.9, 0.004)]).with_markers())
//!     .with(Series::scatter("dense f32", vec![(40.0, 1e-7)]));
//! chart.draw(900, 520).save("chart.png".as_ref()).ok();
//! ```

mod axis;
mod canvas;
mod chart;
mod sheet;

pub use axis::{Axis, Scale};
pub use canvas::{Canvas, OVERSAMPLE};
pub use chart::{Chart, Series, Style};
pub use sheet::{Cell, contact_sheet};
