//! Heat maps: a number over a rectilinear grid, as coloured cells with one colour bar for all.
//!
//! Colours are those of viridis (S. van der Walt and N. Smith, matplotlib 2015, CC0): equal steps of the number look equally far apart,
//! also to colour-blind readers and in a grey print. A cell whose number is infinite is light grey with a
//! cross; one that holds no number (NaN) is left white: nobody asked.

use crate::FigureError;
use crate::draw::{Area, Drawn, TEXT, TICK_TEXT, failed, finish, outline, stroke, text_style, units};
use crate::figure::{Axis, Scale};
use crate::legend::text_width;
use crate::ticks::Ready;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Viridis at eighths.
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
const NO_NUMBER: RGBColor = RGBColor(222, 222, 222);
const CROSS: RGBColor = RGBColor(170, 170, 170);
/// Longer side of a map's plot, CSS pixels, and the least of the shorter one.
const LONG: f64 = 240.0;
const SHORT: f64 = 70.0;
/// Room of the colour bar, its width, and its steps.
const BAR_ROOM: f64 = 84.0;
const BAR_WIDTH: f64 = 12.0;
const BAR_STEPS: u32 = 64;

/// One map.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Its title.
    pub title: String,
    /// Coordinates of the cells' middles along x, ascending.
    pub x_at: Vec<f64>,
    /// Along y.
    pub y_at: Vec<f64>,
    /// A number per cell, x fastest. NaN: the cell is not part of the map. Infinite (or not positive on a logarithmic scale): no colour.
    pub values: Vec<f64>,
    /// Marked places.
    pub points: Vec<(f64, f64)>,
}

/// Maps of one quantity over axes of one unit, which are equally long on both.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// The maps, row by row.
    pub maps: Vec<Map>,
    /// Maps per row.
    pub columns: usize,
    /// What the axes show, with unit.
    pub labels: [String; 2],
    /// What the colours show, with unit.
    pub quantity: String,
    /// How the colours count.
    pub scale: Scale,
}

/// Edges of cells: half-way between middles, the outer ones as far out as the next one is in.
fn edges(middles: &[f64]) -> Vec<f64> {
    let half = |i: usize| {
        let pair = middles.get(i..i + 2).map_or(1.0, |pair| pair[1] - pair[0]);
        0.5 * pair
    };
    let first = middles.first().map(|m| m - half(0));
    let last = middles.last().map(|m| m + half(middles.len().saturating_sub(2)));
    first.into_iter().chain(middles.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]))).chain(last).collect()
}

/// The colour of a share from 0 to 1 as red, green and blue: viridis.
pub fn viridis(share: f64) -> [u8; 3] {
    let at = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let k = (at.floor() as usize).min(VIRIDIS.len() - 2);
    let mix = |i: usize| {
        let (a, b) = (f64::from(VIRIDIS[k][i]), f64::from(VIRIDIS[k + 1][i]));
        (a + (at - k as f64) * (b - a)).round() as u8
    };
    [mix(0), mix(1), mix(2)]
}

fn colour(share: f64) -> RGBColor {
    let [red, green, blue] = viridis(share);
    RGBColor(red, green, blue)
}

impl Maps {
    /// The maps as SVG.
    ///
    /// # Errors
    /// No map, coordinates that do not fit their numbers or do not ascend, no finite number at all.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        let first = self.maps.first().ok_or(FigureError::NoPanel)?;
        for (k, map) in self.maps.iter().enumerate() {
            map.check(k + 1)?;
        }
        let values: Vec<f64> = self.maps.iter().flat_map(|map| map.values.iter().copied()).collect();
        let axis = Axis { scale: self.scale, ..Axis::linear(&self.quantity) };
        let none = || FigureError::NoPoint { panel: 1, title: self.quantity.clone() };
        let bar = Ready::new(&axis, &values, false, 6).ok_or_else(none)?;
        let size = first.plot_size();
        let panel = [size[0] + 4.0 + TEXT * 2.0 + 44.0, size[1] + TEXT * 3.0 + TICK_TEXT + 24.0];
        let columns = self.columns.clamp(1, self.maps.len());
        let rows = self.maps.len().div_ceil(columns);
        let has_gaps = values.iter().any(|v| !v.is_nan() && bar.place(*v).is_none());
        let note = if has_gaps { TEXT * 1.8 } else { 0.0 };
        let width = (panel[0] * columns as f64 + BAR_ROOM).ceil() as i32;
        let height = (panel[1] * rows as f64 + note).ceil() as i32;
        finish([width, height], |root| {
            let (body, foot) = root.split_vertically(units(f64::from(height) - note));
            let (body, right) = body.split_horizontally(units(panel[0] * columns as f64));
            for (area, map) in body.split_evenly((rows, columns)).iter().zip(&self.maps) {
                self.draw(area, map, &bar)?;
            }
            self.draw_bar(&right, &bar, size[1].max(140.0))?;
            if has_gaps {
                let style = text_style(TEXT, Pos::new(HPos::Left, VPos::Top));
                foot.draw_text("grey: infinite", &style, (units(TEXT), 0)).map_err(failed)?;
            }
            Ok(())
        })
    }

    fn draw(&self, area: &Area<'_>, map: &Map, bar: &Ready) -> Drawn {
        let (x_edges, y_edges) = (edges(&map.x_at), edges(&map.y_at));
        let axis = |label: &str, edges: &[f64]| {
            let ends = [edges[0], edges[edges.len() - 1]];
            Ready::new(&Axis::linear(label).at_least(ends[0], ends[1]), &ends, false, 5)
        };
        let no_point = || FigureError::NoPoint { panel: 1, title: map.title.clone() };
        let x = axis(&self.labels[0], &x_edges).ok_or_else(no_point)?;
        let y = axis(&self.labels[1], &y_edges).ok_or_else(no_point)?;
        let (strip, rest) = area.margin(units(4.0), 0, units(4.0), 0).split_vertically(units(TEXT * 1.5));
        let (width, _) = strip.dim_in_pixel();
        let style = text_style(TEXT, Pos::new(HPos::Center, VPos::Top));
        strip.draw_text(&map.title, &style, (width as i32 / 2, 0)).map_err(failed)?;
        let size = map.plot_size();
        let letters = text_width(&"0".repeat(y.longest_label()), TICK_TEXT);
        let left = units(letters + TEXT + 16.0);
        let (rest, _) = rest.split_horizontally(left + units(size[0]));
        let below = units(TICK_TEXT + TEXT + 15.0);
        let (rest, _) = rest.split_vertically(below + units(size[1]));
        let mut chart = ChartBuilder::on(&rest)
            .x_label_area_size(below)
            .y_label_area_size(left)
            .build_cartesian_2d(x.clone(), y.clone())
            .map_err(failed)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(stroke(BLACK, 0.8))
            .x_labels(x.ticks.len().max(2))
            .y_labels(y.ticks.len().max(2))
            .x_label_style(text_style(TICK_TEXT, Pos::new(HPos::Center, VPos::Top)))
            .y_label_style(text_style(TICK_TEXT, Pos::new(HPos::Right, VPos::Center)))
            .axis_desc_style(text_style(TEXT, Pos::new(HPos::Center, VPos::Top)))
            .set_all_tick_mark_size(units(3.5))
            .x_desc(self.labels[0].as_str())
            .y_desc(self.labels[1].as_str())
            .draw()
            .map_err(failed)?;
        for (k, value) in map.values.iter().enumerate() {
            let (i, j) = (k % map.x_at.len(), k / map.x_at.len());
            let corners = [(x_edges[i], y_edges[j]), (x_edges[i + 1], y_edges[j + 1])];
            if let Some(at) = bar.place(*value) {
                let fill = colour((at - bar.low) / (bar.high - bar.low)).filled();
                chart.draw_series([Rectangle::new(corners, fill)]).map_err(failed)?;
            } else if !value.is_nan() {
                chart.draw_series([Rectangle::new(corners, NO_NUMBER.filled())]).map_err(failed)?;
                let [(a, b), (c, d)] = corners;
                for ends in [[(a, b), (c, d)], [(a, d), (c, b)]] {
                    chart
                        .draw_series([PathElement::new(ends.to_vec(), stroke(CROSS, 0.5))])
                        .map_err(failed)?;
                }
            }
        }
        let is_inside = |(a, b): &&(f64, f64)| (x.low..=x.high).contains(a) && (y.low..=y.high).contains(b);
        for at in map.points.iter().filter(is_inside) {
            chart.draw_series([Circle::new(*at, units(3.2), WHITE.filled())]).map_err(failed)?;
            chart.draw_series([Circle::new(*at, units(2.2), BLACK.filled())]).map_err(failed)?;
        }
        Ok(())
    }

    fn draw_bar(&self, area: &Area<'_>, bar: &Ready, length: f64) -> Drawn {
        let (top, left) = (TEXT * 1.5 + 6.0, 8.0);
        let y = |mapped: f64| {
            let share = (mapped - bar.low) / (bar.high - bar.low);
            units(top + length * (1.0 - share))
        };
        let step = (bar.high - bar.low) / f64::from(BAR_STEPS);
        for k in 0..BAR_STEPS {
            let low = bar.low + step * f64::from(k);
            let fill = colour((f64::from(k) + 0.5) / f64::from(BAR_STEPS)).filled();
            let corners = [(units(left), y(low)), (units(left + BAR_WIDTH), y(low + step))];
            area.draw(&Rectangle::new(corners, fill)).map_err(failed)?;
        }
        let corners = [(units(left), y(bar.low)), (units(left + BAR_WIDTH), y(bar.high))];
        area.draw(&outline(corners, stroke(BLACK, 0.8))).map_err(failed)?;
        let style = text_style(TICK_TEXT, Pos::new(HPos::Left, VPos::Center));
        for tick in &bar.ticks {
            let (from, to) = (units(left + BAR_WIDTH), units(left + BAR_WIDTH + 3.5));
            area.draw(&PathElement::new(vec![(from, y(*tick)), (to, y(*tick))], stroke(BLACK, 0.8)))
                .map_err(failed)?;
            area.draw_text(&bar.label(*tick), &style, (to + units(2.0), y(*tick))).map_err(failed)?;
        }
        let letters = bar.ticks.iter().map(|t| bar.label(*t).chars().count()).max().unwrap_or(0);
        let beside = left + BAR_WIDTH + 8.0 + text_width(&"0".repeat(letters), TICK_TEXT) + TEXT * 0.5;
        let upright = text_style(TEXT, Pos::new(HPos::Center, VPos::Top)).transform(FontTransform::Rotate90);
        let at = (units(beside + TEXT), units(top + 0.5 * length));
        area.draw_text(&self.quantity, &upright, at).map_err(failed)
    }
}

impl Map {
    fn check(&self, number: usize) -> Result<(), FigureError> {
        let ascends =
            |at: &[f64]| at.iter().all(|v| v.is_finite()) && at.windows(2).all(|pair| pair[1] > pair[0]);
        let fits = self.values.len() == self.x_at.len() * self.y_at.len() && !self.values.is_empty();
        if fits && ascends(&self.x_at) && ascends(&self.y_at) {
            return Ok(());
        }
        Err(FigureError::Drawing(format!(
            "map {number} (`{}`): {} numbers for {} x {} cells, whose middles must ascend",
            self.title,
            self.values.len(),
            self.x_at.len(),
            self.y_at.len()
        )))
    }

    /// Width and height of the plot, CSS pixels: one unit along x is as long as one along y.
    fn plot_size(&self) -> [f64; 2] {
        let extent = |at: &[f64]| {
            let edges = edges(at);
            edges[edges.len() - 1] - edges[0]
        };
        let (x, y) = (extent(&self.x_at), extent(&self.y_at));
        let scale = LONG / x.max(y);
        [(x * scale).max(SHORT), (y * scale).max(SHORT)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: Vec<f64>) -> Map {
        let (x_at, y_at) = (vec![-100.0, 0.0, 100.0], vec![0.0, 50.0]);
        Map { title: "z = 0 mm".to_owned(), x_at, y_at, values, points: vec![(0.0, 25.0), (1e6, 0.0)] }
    }

    fn maps(maps: Vec<Map>) -> Maps {
        Maps {
            maps,
            columns: 2,
            labels: ["x (mm)".to_owned(), "y (mm)".to_owned()],
            quantity: "error (mm)".to_owned(),
            scale: Scale::Logarithmic,
        }
    }

    #[test]
    fn closed_form_edges_and_colours() {
        assert_eq!(edges(&[0.0, 1.0, 3.0]), [-0.5, 0.5, 2.0, 4.0]);
        assert_eq!(edges(&[5.0]), [4.5, 5.5]);
        assert_eq!(colour(0.0), RGBColor(68, 1, 84));
        assert_eq!(colour(1.0), RGBColor(253, 231, 37));
        assert_eq!(colour(0.5), RGBColor(33, 144, 141));
    }

    #[test]
    fn law_one_colour_bar_for_all_and_grey_for_what_is_infinite() {
        let finite = maps(vec![map(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])]).to_svg().unwrap();
        let two = maps(vec![
            map(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            map(vec![1.0, f64::INFINITY, 3.0, f64::NAN, 5.0, 0.0]),
        ]);
        let svg = two.to_svg().unwrap();
        assert_eq!(svg, two.to_svg().unwrap());
        assert!(!finite.contains("#DEDEDE") && !finite.contains("infinite"));
        assert_eq!(svg.matches("#DEDEDE").count(), 2);
        assert!(svg.contains("grey: infinite") && svg.contains("error (mm)"));
        assert_eq!(svg.matches("z = 0 mm").count(), 2);
    }

    #[test]
    fn law_what_does_not_fit_is_said() {
        let say = |map: Map| maps(vec![map]).to_svg().unwrap_err().to_string();
        assert!(say(map(vec![1.0])).contains("1 numbers for 3 x 2 cells"));
        assert!(say(Map { x_at: vec![0.0, 0.0, 1.0], ..map(vec![1.0; 6]) }).contains("ascend"));
        assert!(maps(vec![map(vec![f64::NAN; 6])]).to_svg().is_err());
        assert!(maps(vec![]).to_svg().is_err());
    }
}
