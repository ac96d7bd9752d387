//! Symbols: the same in a panel and in the legend.

use crate::draw::units;
use crate::figure::{Style, Symbol};
use plotters::element::{Drawable, PointCollection};
use plotters::prelude::*;
use plotters_backend::{BackendCoord, DrawingErrorKind};

/// Half a symbol, CSS pixels.
const HALF: f64 = 2.8;

/// A symbol at a place.
#[derive(Clone, Debug)]
pub(crate) struct SymbolAt<C> {
    pub(crate) at: C,
    pub(crate) style: Style,
}

impl<'a, C> PointCollection<'a, C> for &'a SymbolAt<C> {
    type Point = &'a C;
    type IntoIter = std::iter::Once<&'a C>;

    fn point_iter(self) -> Self::IntoIter {
        std::iter::once(&self.at)
    }
}

impl<C, DB: DrawingBackend> Drawable<DB> for SymbolAt<C> {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        mut places: I,
        backend: &mut DB,
        _: (u32, u32),
    ) -> Result<(), DrawingErrorKind<DB::ErrorType>> {
        let Some((x, y)) = places.next() else { return Ok(()) };
        let [red, green, blue] = self.style.colour;
        let ink = RGBColor(red, green, blue);
        let line = ink.stroke_width(units(1.1) as u32);
        let half = units(HALF);
        let at = |dx: f64, dy: f64| (x + (dx * f64::from(half)) as i32, y + (dy * f64::from(half)) as i32);
        match self.style.symbol {
            Symbol::None => Ok(()),
            Symbol::Ring => {
                // White inside, so that the curve does not run through it.
                backend.draw_circle((x, y), half as u32, &WHITE.filled(), true)?;
                backend.draw_circle((x, y), half as u32, &line, false)
            }
            Symbol::Disc => backend.draw_circle((x, y), half as u32, &ink.filled(), true),
            Symbol::Square => backend.draw_rect(at(-0.9, -0.9), at(0.9, 0.9), &ink.filled(), true),
            Symbol::Triangle => {
                backend.fill_polygon([at(0.0, -1.2), at(1.1, 0.9), at(-1.1, 0.9)], &ink.filled())
            }
            Symbol::Diamond => backend
                .fill_polygon([at(0.0, -1.3), at(1.1, 0.0), at(0.0, 1.3), at(-1.1, 0.0)], &ink.filled()),
            Symbol::Cross => {
                backend.draw_path([at(-1.0, -1.0), at(1.0, 1.0)], &line)?;
                backend.draw_path([at(-1.0, 1.0), at(1.0, -1.0)], &line)
            }
        }
    }
}
