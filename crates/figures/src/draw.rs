//! From a figure to SVG, with plotters.
//!
//! plotters counts in whole units, so a figure is drawn [`UNITS`] times as large as it is shown and the head of the SVG says so:
//! what rounding moves is below an eighth of a pixel, 0.03 mm.

use crate::FigureError;
use crate::figure::{Axis, Dash, Figure, Kind, Panel, Point, Series, Style, Symbol};
use crate::legend::{self, Entry, text_width};
use crate::symbol::SymbolAt;
use crate::ticks::Ready;
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Canvas units per CSS pixel.
const UNITS: i32 = 8;
/// Heights of text, CSS pixels: 8 and 7.5 point at 96 pixels per inch are what papers print in figures.
pub(crate) const TEXT: f64 = 11.0;
pub(crate) const TICK_TEXT: f64 = 10.0;
/// plotters writes a font's height divided by this into the SVG.
const FONT_FACTOR: f64 = 1.24;
const FAMILY: &str = "Helvetica, Arial, Liberation Sans, sans-serif";
const GRID: RGBColor = RGBColor(225, 225, 225);
/// Half the cap of an error bar, CSS pixels.
const CAP: f64 = 2.8;
/// Length of a line's sample in the legend and of the room behind it, CSS pixels.
const SAMPLE: f64 = 24.0;
const SAMPLE_ROOM: f64 = 30.0;
/// Share of a category that its bars fill.
const BARS_FILL: f64 = 0.8;

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Ready, Ready>>;
pub(crate) type Area<'b> = DrawingArea<SVGBackend<'b>, Shift>;
pub(crate) type Drawn = Result<(), FigureError>;

pub(crate) fn failed<E: std::fmt::Display>(error: E) -> FigureError {
    FigureError::Drawing(error.to_string())
}

/// CSS pixels as canvas units.
pub(crate) fn units(pixels: f64) -> i32 {
    (pixels * f64::from(UNITS)).round() as i32
}

pub(crate) fn text_style<'a>(pixels: f64, anchor: Pos) -> TextStyle<'a> {
    let size = pixels * f64::from(UNITS) * FONT_FACTOR;
    TextStyle::from((FAMILY, size).into_font()).color(&BLACK).pos(anchor)
}

fn colour(style: Style) -> RGBColor {
    let [red, green, blue] = style.colour;
    RGBColor(red, green, blue)
}

pub(crate) fn stroke(colour: RGBColor, pixels: f64) -> ShapeStyle {
    ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: units(pixels) as u32 }
}

pub(crate) fn svg(figure: &Figure) -> Result<String, FigureError> {
    if figure.panels.is_empty() {
        return Err(FigureError::NoPanel);
    }
    let columns = figure.columns.min(figure.panels.len());
    let rows = figure.panels.len().div_ceil(columns);
    let [panel_width, panel_height] = figure.panel_size_px.map(|v| v.max(80) as i32);
    let width = panel_width * columns as i32;
    let wide = f64::from(width) - 2.0 * TEXT;
    let (entries, legend_rows) = legend::lay_out(figure, wide, TEXT, SAMPLE_ROOM);
    let row_height = TEXT * 1.6;
    let legend_height = (f64::from(legend_rows) * row_height).ceil() as i32 + i32::from(legend_rows > 0) * 4;
    let height = panel_height * rows as i32 + legend_height;
    finish([width, height], |root| {
        let (head, body) = root.split_vertically(legend_height * UNITS);
        for entry in &entries {
            draw_entry(&head, entry, row_height)?;
        }
        for (k, (area, panel)) in body.split_evenly((rows, columns)).iter().zip(&figure.panels).enumerate() {
            draw_panel(area, panel, k + 1)?;
        }
        Ok(())
    })
}

/// The SVG of so many CSS pixels that `draw` fills: shown at its size, drawn finer.
pub(crate) fn finish(
    [width, height]: [i32; 2],
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<String, FigureError> {
    let mut text = String::new();
    {
        let size = ((width * UNITS) as u32, (height * UNITS) as u32);
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        draw(&root)?;
        root.present().map_err(failed)?;
    }
    let drawn = format!("<svg width=\"{}\" height=\"{}\" ", width * UNITS, height * UNITS);
    let shown = format!("<svg width=\"{width}\" height=\"{height}\" ");
    Ok(text.replacen(&drawn, &shown, 1))
}

/// An axis title with its text turned upright, ticks, a light grid along y.
fn draw_panel(area: &Area<'_>, panel: &Panel, number: usize) -> Drawn {
    let points: Vec<Point> = panel.series.iter().flat_map(|s| s.points.iter().copied()).collect();
    let has_bars = panel.series.iter().any(|s| s.kind == Kind::Bars);
    let no_point = || FigureError::NoPoint {
        panel: number,
        title: if panel.title.is_empty() { panel.y.label.clone() } else { panel.title.clone() },
    };
    let xs: Vec<f64> = points.iter().filter(|p| p.y.is_finite()).map(|p| p.x).collect();
    let ys: Vec<f64> = points.iter().flat_map(|p| p.bar.into_iter().flatten().chain([p.y])).collect();
    // A tick every 60 pixels at most.
    let (width, height) = area.dim_in_pixel();
    let room = |length: u32| (length as usize / units(60.0) as usize).max(3);
    let x = Ready::new(&panel.x, &xs, false, room(width)).ok_or_else(no_point)?;
    let y = Ready::new(&panel.y, &ys, has_bars, room(height) + 1).ok_or_else(no_point)?;
    let mut area = area.margin(units(4.0), units(6.0), units(4.0), units(10.0));
    if !panel.title.is_empty() {
        let (strip, rest) = area.split_vertically(units(TEXT * 1.5));
        let (width, _) = strip.dim_in_pixel();
        let style = text_style(TEXT, Pos::new(HPos::Center, VPos::Top));
        strip.draw_text(&panel.title, &style, (width as i32 / 2, 0)).map_err(failed)?;
        area = rest;
    }
    let letters = text_width(&"0".repeat(y.longest_label()), TICK_TEXT);
    let mut chart = ChartBuilder::on(&area)
        .x_label_area_size(units(TICK_TEXT + TEXT + 15.0))
        .y_label_area_size(units(letters + TEXT + 16.0))
        .build_cartesian_2d(x.clone(), y.clone())
        .map_err(failed)?;
    draw_axes(&mut chart, panel, &x, &y)?;
    let groups = panel.series.iter().filter(|s| s.kind == Kind::Bars).count();
    let mut group = 0;
    for series in &panel.series {
        match series.kind {
            Kind::Bars => {
                draw_bars(&mut chart, series, (&x, &y), (group, groups))?;
                group += 1;
            }
            Kind::Curve | Kind::Steps => draw_curve(&mut chart, series, &x, &y)?,
        }
    }
    Ok(())
}

fn draw_axes(chart: &mut Chart<'_, '_>, panel: &Panel, x: &Ready, y: &Ready) -> Drawn {
    let is_named = |axis: &Axis| !axis.categories.is_empty();
    let mut mesh = chart.configure_mesh();
    if is_named(&panel.x) {
        mesh.disable_x_mesh();
    }
    mesh.bold_line_style(stroke(GRID, 0.6))
        .light_line_style(TRANSPARENT)
        .axis_style(stroke(BLACK, 0.8))
        .max_light_lines(0)
        .x_labels(x.ticks.len().max(2))
        .y_labels(y.ticks.len().max(2))
        .x_label_style(text_style(TICK_TEXT, Pos::new(HPos::Center, VPos::Top)))
        .y_label_style(text_style(TICK_TEXT, Pos::new(HPos::Right, VPos::Center)))
        .axis_desc_style(text_style(TEXT, Pos::new(HPos::Center, VPos::Top)))
        .set_all_tick_mark_size(units(3.5))
        .x_desc(panel.x.label.as_str())
        .y_desc(panel.y.label.as_str());
    mesh.draw().map_err(failed)
}

/// Bars of group `group` of `groups`, side by side within each category.
fn draw_bars(
    chart: &mut Chart<'_, '_>,
    series: &Series,
    axes: (&Ready, &Ready),
    of: (usize, usize),
) -> Drawn {
    let (x, y) = axes;
    let (group, groups) = of;
    let width = BARS_FILL / groups.max(1) as f64;
    let foot = y.place(0.0).unwrap_or(y.low);
    for point in &series.points {
        let (Some(middle), Some(top)) = (x.place(point.x), y.place(point.y)) else { continue };
        let left = middle - 0.5 * BARS_FILL + group as f64 * width;
        let corners = [(left, foot), (left + width, top)];
        let is_published = series.style.symbol == Symbol::Ring;
        let fill = if is_published { WHITE } else { colour(series.style) };
        chart.draw_series([Rectangle::new(corners, fill.filled())]).map_err(failed)?;
        let outline = outline(corners, stroke(BLACK, 0.8));
        chart.draw_series([outline]).map_err(failed)?;
        draw_error_bar(chart, left + 0.5 * width, point, y, BLACK)?;
    }
    Ok(())
}

/// The edge of a rectangle; plotters' own has no width.
pub(crate) fn outline<T: Copy>(corners: [(T, T); 2], line: ShapeStyle) -> PathElement<(T, T)> {
    let [(left, foot), (right, top)] = corners;
    PathElement::new(vec![(left, foot), (left, top), (right, top), (right, foot), (left, foot)], line)
}

/// A vertical line with two caps.
fn draw_error_bar(chart: &mut Chart<'_, '_>, at: f64, point: &Point, y: &Ready, ink: RGBColor) -> Drawn {
    let Some([low, high]) = point.bar else { return Ok(()) };
    // On a logarithmic axis a bar that reaches zero reaches the axis.
    let (Some(high), low) = (y.place(high), y.place(low).unwrap_or(y.low)) else { return Ok(()) };
    let line = stroke(ink, 0.8);
    chart.draw_series([PathElement::new(vec![(at, low), (at, high)], line)]).map_err(failed)?;
    let cap = units(CAP);
    for end in [low, high] {
        let cap = EmptyElement::at((at, end)) + PathElement::new(vec![(-cap, 0), (cap, 0)], line);
        chart.draw_series([cap]).map_err(failed)?;
    }
    Ok(())
}

fn draw_curve(chart: &mut Chart<'_, '_>, series: &Series, x: &Ready, y: &Ready) -> Drawn {
    let ink = colour(series.style);
    // Whole stretches between gaps.
    let mut stretches: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for point in &series.points {
        match (x.place(point.x), y.place(point.y), stretches.last_mut()) {
            (Some(a), Some(b), Some(stretch)) => {
                if let (Kind::Steps, Some((_, before))) = (series.kind, stretch.last().copied()) {
                    stretch.push((a, before));
                }
                stretch.push((a, b));
            }
            (.., Some(stretch)) if !stretch.is_empty() => stretches.push(Vec::new()),
            _ => {}
        }
    }
    for stretch in stretches {
        draw_line(chart, stretch, series.style.dash, ink)?;
    }
    for point in &series.points {
        let (Some(a), Some(b)) = (x.place(point.x), y.place(point.y)) else { continue };
        draw_error_bar(chart, a, point, y, ink)?;
        if series.style.symbol != Symbol::None {
            chart.draw_series([SymbolAt { at: (a, b), style: series.style }]).map_err(failed)?;
        }
    }
    Ok(())
}

/// Dash and gap, CSS pixels.
fn dashes(dash: Dash) -> Option<(f64, f64)> {
    match dash {
        Dash::Dashed => Some((5.0, 3.0)),
        Dash::Dotted => Some((1.5, 2.0)),
        Dash::Solid | Dash::None => None,
    }
}

fn draw_line(chart: &mut Chart<'_, '_>, points: Vec<(f64, f64)>, dash: Dash, ink: RGBColor) -> Drawn {
    let line = stroke(ink, 1.2);
    if points.len() < 2 || dash == Dash::None {
        return Ok(());
    }
    match dashes(dash) {
        None => chart.draw_series([PathElement::new(points, line)]).map_err(failed)?,
        Some((on, off)) => {
            let dashed = DashedLineSeries::new(points, units(on), units(off), line);
            chart.draw_series(dashed).map_err(failed)?
        }
    };
    Ok(())
}

fn draw_entry(area: &Area<'_>, entry: &Entry, row_height: f64) -> Drawn {
    let y = units((f64::from(entry.row) + 0.5) * row_height) + units(2.0);
    let left = units(TEXT + f64::from(entry.x));
    let right = left + units(SAMPLE);
    let ink = colour(entry.style);
    if entry.kind == Kind::Bars {
        let corners = [(left + units(6.0), y - units(4.0)), (right, y + units(4.0))];
        let fill = if entry.style.symbol == Symbol::Ring { WHITE } else { ink };
        area.draw(&Rectangle::new(corners, fill.filled())).map_err(failed)?;
        area.draw(&outline(corners, stroke(BLACK, 0.8))).map_err(failed)?;
    } else {
        let line = stroke(ink, 1.2);
        match (entry.style.dash, dashes(entry.style.dash)) {
            (Dash::None, _) => {}
            (_, None) => area.draw(&PathElement::new(vec![(left, y), (right, y)], line)).map_err(failed)?,
            (_, Some((on, off))) => {
                let ends = [(left, y), (right, y)];
                let dashed = DashedPathElement::new(ends, units(on), units(off), line);
                area.draw(&dashed).map_err(failed)?;
            }
        }
        area.draw(&SymbolAt { at: (i32::midpoint(left, right), y), style: entry.style }).map_err(failed)?;
    }
    let style = text_style(TEXT, Pos::new(HPos::Left, VPos::Center));
    area.draw_text(&entry.name, &style, (left + units(SAMPLE_ROOM), y)).map_err(failed)
}
