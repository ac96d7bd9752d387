//! Triangle meshes from files: STL (binary, ASCII), OBJ, PLY. Coordinates are those of the file; polygons become fans.
//!
//! Memory grows with what is there, not with what a header promises.

mod obj;
mod ply;
mod stl;

use super::error::ImportError;
use nalgebra::Point3;
use std::path::Path;

/// Largest file read: two million triangles of ASCII STL are about 500 MB.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Triangles as they stand in a file, in its unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Soup {
    /// Corners; in an STL each triangle has its own three.
    pub vertices: Vec<Point3<f64>>,
    /// Corners of each triangle, indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// A format's complaint: where, and what.
pub(super) struct Problem {
    pub(super) place: String,
    pub(super) problem: String,
}

pub(super) fn problem(place: impl Into<String>, problem: impl Into<String>) -> Problem {
    Problem { place: place.into(), problem: problem.into() }
}

/// The bytes of a file.
///
/// # Errors
/// [`ImportError::Unreadable`].
pub fn bytes_of(path: &Path) -> Result<Vec<u8>, ImportError> {
    let refuse = |reason: String| ImportError::Unreadable { file: path.display().to_string(), reason };
    let size = std::fs::metadata(path).map_err(|error| refuse(error.to_string()))?.len();
    if size > MAX_FILE_BYTES {
        return Err(refuse(format!("{size} bytes are more than {MAX_FILE_BYTES}")));
    }
    std::fs::read(path).map_err(|error| refuse(error.to_string()))
}

/// The triangles of a file's bytes; `file` tells the format by its ending and stands in messages.
///
/// # Errors
/// [`ImportError::UnknownFormat`], [`ImportError::Malformed`].
pub fn soup(bytes: &[u8], file: &str) -> Result<Soup, ImportError> {
    let ending = Path::new(file).extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let read = match ending.as_deref() {
        Some("stl") => stl::read(bytes),
        Some("obj") => obj::read(bytes),
        Some("ply") => ply::read(bytes),
        _ => return Err(ImportError::UnknownFormat { file: file.to_owned() }),
    };
    let soup = read.and_then(checked);
    soup.map_err(|p| ImportError::Malformed { file: file.to_owned(), place: p.place, problem: p.problem })
}

fn checked(soup: Soup) -> Result<Soup, Problem> {
    for (index, triangle) in soup.triangles.iter().enumerate() {
        for corner in triangle {
            let at = format!("triangle {}", index + 1);
            let Some(vertex) = soup.vertices.get(*corner as usize) else {
                let count = soup.vertices.len();
                return Err(problem(at, format!("names vertex {corner} (from 0), there are {count}")));
            };
            if !vertex.iter().all(|v| v.is_finite()) {
                return Err(problem(at, format!("a corner is ({}, {}, {})", vertex.x, vertex.y, vertex.z)));
            }
        }
    }
    Ok(soup)
}

/// Adds a polygon as a fan around its first corner.
pub(super) fn push_polygon(triangles: &mut Vec<[u32; 3]>, corners: &[u32]) {
    for pair in corners.get(1..).unwrap_or_default().windows(2) {
        triangles.push([corners[0], pair[0], pair[1]]);
    }
}
