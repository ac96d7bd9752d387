//! What can be wrong with a person's surface.

use super::{RADIUS_M, SIZE_M};
use crate::error::AnatomyError;
use crate::segment::SegmentKey;
use nalgebra::Point3;

/// Why a gut could not be imported. Every message names the file and the place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ImportError {
    /// The file cannot be opened or read.
    #[error("{file}: cannot be read: {reason}")]
    Unreadable {
        /// The file.
        file: String,
        /// What the system says.
        reason: String,
    },
    /// A name whose ending tells no format.
    #[error(
        "{file}: neither surface nor label volume; allowed: .stl, .obj, .ply, .nii, .nii.gz, .mha, .mhd (its ending tells the format)"
    )]
    UnknownFormat {
        /// The file.
        file: String,
    },
    /// The file breaks the rules of its format.
    #[error("{file}, {place}: {problem}")]
    Malformed {
        /// The file.
        file: String,
        /// Line, byte or triangle.
        place: String,
        /// What is wrong.
        problem: String,
    },
    /// A label volume that cannot be used.
    #[error("{file}: {problem}")]
    Volume {
        /// The file.
        file: String,
        /// What is wrong, and where.
        problem: String,
    },
    /// A label volume in which it is not clear, or not there, what the lumen is.
    #[error("{file}: {}", label_question(asked, found))]
    Labels {
        /// The file.
        file: String,
        /// Labels asked for.
        asked: Vec<i64>,
        /// Labels that are there beside 0, the first of them.
        found: Vec<i64>,
    },
    /// Too few or too many triangles.
    #[error(
        "{file}: {count} triangles; allowed: {low} to {high} (fewer describe no gut, more are decimated first)"
    )]
    Triangles {
        /// The file.
        file: String,
        /// Triangles there are.
        count: usize,
        /// Least allowed.
        low: usize,
        /// Most allowed.
        high: usize,
    },
    /// The size fits no gut in the unit given.
    #[error("{file}: {}", unit_question(*size_m, *radius_m, *factor, suggestions))]
    Unit {
        /// The file.
        file: String,
        /// Largest side of its box with the factor used, m.
        size_m: f64,
        /// Mean radius of its lumen with the factor used, m; 0 where the box alone tells that it is none.
        radius_m: f64,
        /// Factor used, m per unit of the file.
        factor: f64,
        /// Factors that come nearest to a gut, with the size each gives, m.
        suggestions: Vec<(f64, f64)>,
    },
    /// A rim that is too wide to be closed without being asked.
    #[error(
        "{file}: open at {} mm: a rim of {edges} edges, {diameter_mm:.1} mm wide, where at most {limit_mm:.1} mm are closed \
         unasked; close it, or give waypoints (it is then closed by a flat fan)",
        place(.at_m)
    )]
    Open {
        /// The file.
        file: String,
        /// Middle of the rim, surface frame, m.
        at_m: Point3<f64>,
        /// Its edges.
        edges: usize,
        /// Its width, mm.
        diameter_mm: f64,
        /// Widest rim closed unasked, mm.
        limit_mm: f64,
    },
    /// Walls with a thickness whose inner face could not be told.
    #[error(
        "{file}: {percent:.0} % of the surface, among it around {} mm, look like the two faces of a wall, not like a lumen; the line would \
         run within the wall; keep the inner face alone, or give waypoints in the lumen", place(.at_m)
    )]
    Wall {
        /// The file.
        file: String,
        /// A place on it, surface frame, m.
        at_m: Point3<f64>,
        /// Part of the area, percent.
        percent: f64,
    },
    /// Nothing is enclosed.
    #[error("{file}: the surface encloses nothing (around {} mm): {reason}", place(.at_m))]
    NoInside {
        /// The file.
        file: String,
        /// Middle of the surface, m.
        at_m: Point3<f64>,
        /// Why.
        reason: String,
    },
    /// Several lumina that do not meet.
    #[error(
        "{file}: the lumen is in {} parts that do not meet: {}; join them, remove what is no lumen, or give waypoints that \
         lead from one to the next",
        parts.len(),
        list_parts(parts)
    )]
    SeveralParts {
        /// The file.
        file: String,
        /// Middle (m) and volume (ml) of each, largest first.
        parts: Vec<(Point3<f64>, f64)>,
    },
    /// A waypoint outside the lumen.
    #[error("{file}: waypoint {} at {} mm lies {distance_mm:.1} mm outside the lumen; at most {limit_mm:.1} mm are forgiven", index + 1, place(.at_m))]
    Waypoint {
        /// The file.
        file: String,
        /// Its place in the list, from 0.
        index: usize,
        /// Where it is, m.
        at_m: Point3<f64>,
        /// Distance to the lumen, mm.
        distance_mm: f64,
        /// Distance forgiven, mm.
        limit_mm: f64,
    },
    /// Waypoints that cannot be used.
    #[error(
        "{file}: {count} waypoint(s); give none, the oral end where the lumen is in one part, or the two ends with what lies between them in order"
    )]
    WaypointCount {
        /// The file.
        file: String,
        /// How many.
        count: usize,
    },
    /// Two waypoints with no way between them.
    #[error("{file}: no way through the lumen from {} mm to {} mm", place(.from_m), place(.to_m))]
    NoWay {
        /// The file.
        file: String,
        /// From here, m.
        from_m: Point3<f64>,
        /// To here, m.
        to_m: Point3<f64>,
    },
    /// The lumen is shorter than it is wide.
    #[error(
        "{file}: the way through the lumen is {length_mm:.1} mm long and {width_mm:.1} mm wide; that is no tube"
    )]
    NoTube {
        /// The file.
        file: String,
        /// Length, mm.
        length_mm: f64,
        /// Width, mm.
        width_mm: f64,
    },
    /// Segments that do not follow each other along the line.
    #[error(
        "{file}: `{after}` would begin {at_mm:.1} mm along the line, not after `{before}` at {before_mm:.1} mm"
    )]
    SegmentOrder {
        /// The file.
        file: String,
        /// The segment before.
        before: SegmentKey,
        /// Where it begins, mm.
        before_mm: f64,
        /// The one that does not follow.
        after: SegmentKey,
        /// Where it would begin, mm.
        at_mm: f64,
    },
    /// A segment is said to begin far from the line.
    #[error(
        "{file}: the place where `{segment}` is to begin is {away_mm:.0} mm from the line; allowed: to {most_mm:.0} mm (x,y,z in mm of the surface's frame)"
    )]
    StartAway {
        /// The file.
        file: String,
        /// The segment.
        segment: SegmentKey,
        /// How far it is, mm.
        away_mm: f64,
        /// How far it may be, mm.
        most_mm: f64,
    },
    /// What was found makes no tract.
    #[error("{file}: {error}")]
    Tract {
        /// The file.
        file: String,
        /// What is wrong.
        error: AnatomyError,
    },
}

/// A place for people: millimetres, surface frame.
pub(super) fn place(point: &Point3<f64>) -> String {
    format!("({:.1}, {:.1}, {:.1})", 1e3 * point.x, 1e3 * point.y, 1e3 * point.z)
}

fn list_parts(parts: &[(Point3<f64>, f64)]) -> String {
    let words: Vec<String> =
        parts.iter().take(8).map(|(at, ml)| format!("{ml:.1} ml around {} mm", place(at))).collect();
    words.join(", ")
}

fn label_question(asked: &[i64], found: &[i64]) -> String {
    let list = |labels: &[i64]| labels.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if found.is_empty() {
        "holds no label but 0; there is no lumen in it".to_owned()
    } else if asked.is_empty() {
        format!("holds labels {}; which of them are the lumen?", list(found))
    } else {
        format!("asked for labels {}; there are: {}", list(asked), list(found))
    }
}

fn unit_question(size_m: f64, radius_m: f64, factor: f64, suggestions: &[(f64, f64)]) -> String {
    let choices: Vec<String> = suggestions
        .iter()
        .map(|(factor, size_m)| format!("{factor} (its box is then {size_m:.3} m)"))
        .collect();
    let lumen = if radius_m > 0.0 {
        format!(
            " and its lumen {:.3} mm in radius (a gut's: {:.0} to {:.0})",
            1e3 * radius_m,
            1e3 * RADIUS_M.0,
            1e3 * RADIUS_M.1
        )
    } else {
        String::new()
    };
    format!(
        "with {factor} m per unit its box is {size_m:.4} m (a gut's: {} to {}){lumen}, which is no gut; which unit has the file? \
         Factors that come nearest: {}",
        SIZE_M.0,
        SIZE_M.1,
        choices.join(", ")
    )
}
