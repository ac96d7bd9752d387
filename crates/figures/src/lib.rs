//! Charts for papers, as SVG text.
//!
//! A [`Figure`] is one panel or several in a grid; a [`Panel`] has two axes and series: curves with symbols and error bars, steps
//! (cumulative distributions), grouped bars over categories. What a figure looks like is decided here and once: Okabe and Ito's
//! colours, which people with colour-blindness tell apart, a symbol and a dash of its own for each series so that a black-and-white
//! print reads too, ticks at 1, 2 and 5, the legend above the panels where it hides nothing.
//!
//! ```
//! use lumenav_figures::{Axis, Figure, Panel, Series};
//! let panel = Panel::new(Axis::linear("diameter (cm)"), Axis::logarithmic("lines per window"))
//!     .with(Series::published("than2015").points(&[(20.0, 2410.0), (25.0, 1593.0)]))
//!     .with(Series::ours(0, "lumenav").points_with_bars(&[(20.0, 2391.0, 12.0), (25.0, 1580.0, 9.0)]));
//! let svg = Figure::of(panel).to_svg()?;
//! assert!(svg.starts_with("<svg") && svg.contains("lines per window"));
//! # Ok::<(), lumenav_figures::FigureError>(())
//! ```
//!
//! The bytes depend on the figure alone: no clock, no random number, no installed font (text stays text, the viewer sets it).
//! Numbers that are not finite, or not positive on a logarithmic axis, leave a gap in a curve. [`Maps`] are numbers over a plane in colours. Not covered: 3-D, contours.

mod draw;
mod figure;
mod legend;
mod map;
mod symbol;
mod ticks;

pub use figure::{Axis, Dash, Figure, Kind, Panel, Point, Scale, Series, Style, Symbol};
pub use map::{Map, Maps, viridis};

/// What keeps a figure from being drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FigureError {
    /// A figure without panels.
    #[error("a figure without panels")]
    NoPanel,
    /// Nothing that could be drawn in a panel.
    #[error("panel {panel} (`{title}`) has no point that can be drawn")]
    NoPoint {
        /// Number of the panel, from 1.
        panel: usize,
        /// Its title, or the label of its y axis.
        title: String,
    },
    /// More than the drawing library could do.
    #[error("drawing failed: {0}")]
    Drawing(String),
}
