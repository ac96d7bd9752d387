//! Reads tract files: one table `[tract]`, its units in the keys, its frame stated.
//!
//! ```toml
//! [tract]
//! frame = "ras"                      # or "lps": x and y change sign; required
//! name = "colon"                     # default: "tract"
//! source = "…"                       # where the numbers come from
//! ends = ["closed", "exit"]          # oral and anal end; this is the default
//! default_radius_mm = 15.0           # where points give no radius
//! torso_box_half_extents_m = [0.2, 0.12, 0.2]
//!
//! [[tract.segment]]                  # in order from mouth to anus
//! name = "ascending"                 # a segment key
//! points_mm = [[x, y, z, radius], …] # or points_m; the radius may be left out
//! # shape = { kind = "helix", … }    # instead of points, see `crate::shape`
//! length_m = 0.2                     # optional, compared with what is built
//! wall = { friction = 0.1 }          # optional, overrides the segment's default wall
//! ```
//!
//! Instead of segments there may be `centre_line_csv = "file.csv"`, a CSV with the columns `segment, s, x, y, z, radius` in
//! metres (a header line; `#` begins a comment; `s` is not used: arc lengths are those of the built line; an empty radius
//! takes `default_radius_mm`), and `segment_names = { esophagus_part = "oesophagus" }` for names that are no segment keys.
//! `interpolation` may say `cubic_c2`, which is what there is.

use crate::error::AnatomyError;
use crate::segment::{SegmentKey, WallTable};
use crate::shape;
use crate::tract::{End, SegmentPoints, Tract, TractDraft, TractReport};
use lumenav_core::config::quantity::Positive;
use lumenav_core::{ConfigError, Node};
use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use std::collections::BTreeMap;

mod csv;

/// A stated length may differ from the built one by this fraction before it is mentioned.
const LENGTH_TOLERANCE: f64 = 0.02;

/// Orientation of a file's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axes {
    /// x right, y anterior, z superior: the torso frame.
    Ras,
    /// x left, y posterior, z superior.
    Lps,
}

impl Axes {
    /// The name as files spell it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ras => "ras",
            Self::Lps => "lps",
        }
    }

    /// The point in the torso frame; its own inverse.
    pub(crate) fn torso_from_file(self, point: Point3<f64>) -> Point3<f64> {
        match self {
            Self::Ras => point,
            Self::Lps => Point3::new(-point.x, -point.y, point.z),
        }
    }
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Interpolation {
    CubicC2,
}

/// The `[tract]` table.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TractTable {
    frame: Axes,
    name: Option<String>,
    source: Option<String>,
    #[serde(rename = "interpolation")]
    _interpolation: Option<Interpolation>,
    ends: Option<[End; 2]>,
    default_radius_mm: Option<Positive>,
    torso_box_half_extents_m: Option<[Positive; 3]>,
    centre_line_csv: Option<String>,
    #[serde(default)]
    segment_names: BTreeMap<String, SegmentKey>,
    #[serde(default)]
    segment: Vec<SegmentTable>,
}

/// A `[[tract.segment]]` table.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SegmentTable {
    name: SegmentKey,
    source: Option<String>,
    length_m: Option<Positive>,
    points_m: Option<Vec<Row>>,
    points_mm: Option<Vec<Row>>,
    shape: Option<toml::Table>,
    default_radius_mm: Option<Positive>,
    #[serde(default)]
    wall: WallTable,
}

/// `[x, y, z]` or `[x, y, z, radius]`, checked by [`Row::checked`], where the row's line is known.
#[derive(Debug, Clone, Deserialize)]
#[serde(transparent)]
struct Row(Vec<f64>);

impl Row {
    /// Position and radius, in the row's unit; in words what is wrong with it.
    fn checked(&self) -> Result<([f64; 3], Option<f64>), String> {
        if let Some(bad) = self.0.iter().find(|v| !v.is_finite()) {
            return Err(format!("{bad} is not allowed here; points are finite numbers"));
        }
        match self.0[..] {
            [x, y, z] => Ok(([x, y, z], None)),
            [x, y, z, radius] if radius > 0.0 => Ok(([x, y, z], Some(radius))),
            [_, _, _, radius] => Err(format!("a radius of {radius} is not allowed; it must be above 0")),
            _ => Err(format!("expected [x, y, z, radius] or [x, y, z], found {} numbers", self.0.len())),
        }
    }
}

/// Which part of a file's tract is wanted, and how large.
#[derive(Debug, Clone, PartialEq)]
pub struct TractOptions {
    /// Segments to keep, consecutive and in order; empty for all.
    pub segments: Vec<SegmentKey>,
    /// Factor on the centre line about the torso's origin.
    pub length_scale: f64,
    /// Factor on the radii.
    pub radius_scale: f64,
}

impl Default for TractOptions {
    fn default() -> Self {
        Self { segments: Vec::new(), length_scale: 1.0, radius_scale: 1.0 }
    }
}

/// Reads and builds the tract of a file.
///
/// # Errors
/// [`ConfigError`] with file, line, key and what is allowed. Errors of `options` are reported at `tract.segment`, `tract`.
pub fn load(node: &Node, options: &TractOptions) -> Result<(Tract, TractReport), ConfigError> {
    let (draft, stated) = read_with_lengths(node)?;
    let at_tract = |error: &AnatomyError| node.error_at("tract", &error.to_string());
    let skipped = options
        .segments
        .first()
        .and_then(|key| draft.segments.iter().position(|segment| segment.key == *key))
        .unwrap_or(0);
    let draft = draft
        .select(&options.segments)
        .and_then(|draft| draft.scaled(options.length_scale, options.radius_scale))
        .map_err(|error| at_tract(&error))?;
    let (tract, mut report) =
        draft.clone().build().map_err(|error| geometry_error(node, &draft, skipped, &error))?;
    for segment in &tract.segments {
        let Some(stated_m) = stated.get(&segment.key).map(|length| length * options.length_scale) else {
            continue;
        };
        let difference = segment.length_m() / stated_m - 1.0;
        if difference.abs() > LENGTH_TOLERANCE {
            report.warnings.push(format!(
                "`{}` is {:.4} m long, {:+.1} % off the stated length of {stated_m:.4} m",
                segment.key,
                segment.length_m(),
                100.0 * difference
            ));
        }
    }
    if tract.source.is_empty() && tract.segments.iter().any(|segment| segment.source.is_empty()) {
        report.warnings.push("the file states no `source` for its numbers".to_owned());
    }
    Ok((tract, report))
}

/// Reads the tract of a file without building it.
///
/// # Errors
/// As [`load`].
pub fn read(node: &Node) -> Result<TractDraft, ConfigError> {
    read_with_lengths(node).map(|(draft, _)| draft)
}

type StatedLengths = BTreeMap<SegmentKey, f64>;

fn read_with_lengths(node: &Node) -> Result<(TractDraft, StatedLengths), ConfigError> {
    if let Some(other) = node.keys().iter().find(|key| *key != "tract") {
        return Err(node.error_at(other, "unknown key; a tract file has one table, [tract]"));
    }
    let Some(tract_node) = node.child("tract") else {
        return Err(node.error("there is no table [tract]"));
    };
    let table: TractTable = tract_node.parse_quietly()?;
    let (segments, stated) = match &table.centre_line_csv {
        Some(_) if !table.segment.is_empty() => {
            return Err(
                tract_node.error_at("centre_line_csv", "give either a CSV or [[tract.segment]], not both")
            );
        }
        Some(file) => (csv::read(&tract_node, file, &table)?, StatedLengths::new()),
        None if table.segment.is_empty() => {
            return Err(tract_node.error("a tract needs [[tract.segment]] or `centre_line_csv`"));
        }
        None => from_tables(&tract_node, &table)?,
    };
    let ends = table.ends.map_or((End::Closed, End::Exit), |[oral, anal]| (oral, anal));
    let draft = TractDraft {
        name: table.name.unwrap_or_else(|| "tract".to_owned()),
        segments,
        ends,
        torso_half_extents_m: table.torso_box_half_extents_m.map(|h| Vector3::new(h[0].0, h[1].0, h[2].0)),
        source: table.source.unwrap_or_default(),
    };
    Ok((draft, stated))
}

fn from_tables(node: &Node, table: &TractTable) -> Result<(Vec<SegmentPoints>, StatedLengths), ConfigError> {
    let nodes = node.children("segment")?;
    let mut stated = StatedLengths::new();
    let mut segments: Vec<SegmentPoints> = Vec::new();
    for (segment, segment_node) in table.segment.iter().zip(&nodes) {
        if let Some(before) = segments.last().filter(|before| before.key >= segment.name) {
            let (before, after) = (before.key, segment.name);
            let message =
                format!("`{after}` cannot follow `{before}`; the order is: {}", SegmentKey::allowed());
            return Err(segment_node.error_at("name", &message));
        }
        if let Some(length) = segment.length_m {
            stated.insert(segment.name, length.0);
        }
        segments.push(segment_points(segment_node, segment, table)?);
    }
    Ok((segments, stated))
}

fn segment_points(
    node: &Node,
    segment: &SegmentTable,
    table: &TractTable,
) -> Result<SegmentPoints, ConfigError> {
    let default_m = segment.default_radius_mm.or(table.default_radius_mm).map(|radius| 1e-3 * radius.0);
    let (points, radii) = match (&segment.points_m, &segment.points_mm, &segment.shape) {
        (Some(rows), None, None) => rows_in_metres(node, "points_m", rows, 1.0, default_m)?,
        (None, Some(rows), None) => rows_in_metres(node, "points_mm", rows, 1e-3, default_m)?,
        (None, None, Some(_)) => {
            let points = shape::points(&node.child_or_empty("shape"))?;
            let radius = default_m.ok_or_else(|| node.error("a shape needs `default_radius_mm`"))?;
            let radii = vec![radius; points.len()];
            (points, radii)
        }
        _ => return Err(node.error("a segment needs one of: points_m, points_mm, shape")),
    };
    Ok(SegmentPoints {
        key: segment.name,
        points_m: points.into_iter().map(|point| table.frame.torso_from_file(point)).collect(),
        radii_m: radii,
        wall: segment.wall.over(segment.name.default_wall()),
        source: segment.source.clone().unwrap_or_default(),
    })
}

fn rows_in_metres(
    node: &Node,
    key: &str,
    rows: &[Row],
    unit: f64,
    default_m: Option<f64>,
) -> Result<(Vec<Point3<f64>>, Vec<f64>), ConfigError> {
    if rows.len() < 2 {
        return Err(
            node.error_at(key, &format!("a segment needs at least 2 points, there are {}", rows.len()))
        );
    }
    let (mut points, mut radii) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
    for (i, row) in rows.iter().enumerate() {
        let (position, radius) = row.checked().map_err(|message| row_error(node, key, i, &message))?;
        let radius = radius.map(|radius| radius * unit).or(default_m).ok_or_else(|| {
            row_error(
                node,
                key,
                i,
                "no radius: give [x, y, z, radius], or `default_radius_mm` for all points",
            )
        })?;
        points.push(Point3::from(Vector3::from(position) * unit));
        radii.push(radius);
    }
    Ok((points, radii))
}

/// An error at a row of a list of points.
fn row_error(node: &Node, key: &str, row: usize, message: &str) -> ConfigError {
    let rows = node.children(key).unwrap_or_default();
    rows.get(row).map_or_else(|| node.error_at(key, message), |at| at.error(message))
}

/// A geometric error at the row that caused it, or at the table.
fn geometry_error(node: &Node, draft: &TractDraft, skipped: usize, error: &AnatomyError) -> ConfigError {
    let message = error.to_string();
    let tract = node.child_or_empty("tract");
    let (AnatomyError::PointNotFinite { index }
    | AnatomyError::PointTooFar { index, .. }
    | AnatomyError::RepeatedPoint { index, .. }
    | AnatomyError::Cusp { index }) = error
    else {
        let second = match error {
            AnatomyError::Gap { after, .. } => Some(*after),
            AnatomyError::SelfApproach { second, .. } => Some(*second),
            _ => None,
        };
        let place = second.and_then(|key| draft.segments.iter().position(|segment| segment.key == key));
        return at_segment(&tract, place.map(|place| place + skipped), &message);
    };
    let Some((segment, row)) = draft.locate(*index) else { return tract.error(&message) };
    let nodes = tract.children("segment").unwrap_or_default();
    let Some(segment_node) = nodes.get(segment + skipped) else {
        let key = draft.segments[segment].key;
        return tract.error(&format!("in `{key}`, point {row}: {message}"));
    };
    match ["points_m", "points_mm"].iter().find(|key| segment_node.child(key).is_some()) {
        Some(key) => row_error(segment_node, key, row, &message),
        None => segment_node.error(&message),
    }
}

fn at_segment(tract: &Node, place: Option<usize>, message: &str) -> ConfigError {
    let nodes = tract.children("segment").unwrap_or_default();
    place.and_then(|place| nodes.get(place)).map_or_else(|| tract.error(message), |node| node.error(message))
}
