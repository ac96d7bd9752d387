//! Label volumes (NIfTI, MetaImage): voxels of a label become a closed surface, which then goes the way of every surface.
//!
//! Naive surface nets (Gibson, MICCAI 1998, without relaxation): one corner per cell of 2 x 2 x 2 voxel middles that is part in, part out, at
//! the mean of the middles of those of its twelve edges that have one end in and one out; one quadrilateral around each such edge:
//!
//! ```text
//! place = first + E (i, j, k),   E: columns are the voxels' edges, m
//! ```
//!
//! Every side of a quadrilateral belongs to a face of a cell, and around a face the label changes an even number of times: the boundary
//! modulo 2 is empty, also where voxels touch at an edge or a corner. What lies beyond the image counts as out.
//!
//! Neglected: loops of one label that touch have no wall between them and are fused, which the handles tell.

use super::error::ImportError;
use super::surface::Surface;
use crate::phantom::image::{self, Header};
use crate::tract_file::Axes;
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Labels listed in a question at most.
const MOST_LISTED: usize = 32;

/// Whether a file's name is that of a label volume.
pub(super) fn is_volume(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    [".nii", ".nii.gz", ".mha", ".mhd"].iter().any(|ending| name.ends_with(ending))
}

/// Surface of the voxels that hold one of `labels`, m, and the axes of the format. No labels: the only one there is beside 0.
pub(super) fn surface(path: &Path, file: &str, labels: &[i64]) -> Result<(Surface, Axes), ImportError> {
    let refuse = |problem: String| ImportError::Volume { file: file.to_owned(), problem };
    let mut header = image::open(path).map_err(refuse)?;
    header.check().map_err(refuse)?;
    let (is_in, found) = mask(&mut header, labels).map_err(refuse)?;
    let is_asked_found = labels.iter().all(|label| found.contains(label));
    let is_clear = if labels.is_empty() { found.len() == 1 } else { is_asked_found };
    if !is_clear {
        let found = found.into_iter().take(MOST_LISTED).collect();
        return Err(ImportError::Labels { file: file.to_owned(), asked: labels.to_vec(), found });
    }
    let axes = if header.is_lps { Axes::Lps } else { Axes::Ras };
    Ok((Net::of(&header, &is_in), axes))
}

/// Which voxels are the lumen's, and the labels that are there beside 0.
fn mask(header: &mut Header, labels: &[i64]) -> Result<(Vec<bool>, BTreeSet<i64>), String> {
    let (mut is_in, mut found) = (Vec::new(), BTreeSet::new());
    header.each_label(|label| {
        if label != 0 {
            found.insert(label);
        }
        is_in.push(if labels.is_empty() { label != 0 } else { labels.contains(&label) });
        Ok(())
    })?;
    Ok((is_in, found))
}

/// A surface under way.
struct Net<'a> {
    size: [i64; 3],
    is_in: &'a [bool],
    first_m: Point3<f64>,
    edges_m: nalgebra::Matrix3<f64>,
    corner_of: HashMap<[i64; 3], u32>,
    surface: Surface,
}

impl<'a> Net<'a> {
    fn of(header: &Header, is_in: &'a [bool]) -> Surface {
        let size = header.size.map(|n| n as i64);
        let middle = Vector3::from(size.map(|n| 0.5 * (n - 1) as f64));
        // Without a place of its own the image's middle is the origin.
        let first_m = Point3::from(header.first_m.unwrap_or_else(|| -(header.edges_m * middle)));
        let edges_m = header.edges_m;
        let mut net =
            Net { size, is_in, first_m, edges_m, corner_of: HashMap::new(), surface: Surface::default() };
        let is_mirrored = edges_m.determinant() < 0.0;
        for index in (0..is_in.len()).filter(|index| is_in[*index]) {
            let i = index as i64;
            let here = [i % size[0], i / size[0] % size[1], i / (size[0] * size[1])];
            for axis in 0..3 {
                for is_up in [false, true] {
                    net.face(here, axis, is_up, is_mirrored);
                }
            }
        }
        net.surface
    }

    fn holds(&self, at: [i64; 3]) -> bool {
        let [x, y, z] = at;
        let is_there = (0..3).all(|axis| (0..self.size[axis]).contains(&at[axis]));
        is_there && self.is_in[(x + self.size[0] * (y + self.size[1] * z)) as usize]
    }

    /// The quadrilateral between a voxel that is in and its neighbour, where that is out.
    fn face(&mut self, here: [i64; 3], axis: usize, is_up: bool, is_mirrored: bool) {
        let mut next = here;
        next[axis] += if is_up { 1 } else { -1 };
        if self.holds(next) {
            return;
        }
        let low = if is_up { here } else { next };
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let cell = |back_u: i64, back_v: i64| {
            let mut cell = low;
            cell[u] -= back_u;
            cell[v] -= back_v;
            cell
        };
        // Counter-clockwise as seen from above the axis.
        let [a, b, c, d] = [cell(0, 0), cell(1, 0), cell(1, 1), cell(0, 1)].map(|cell| self.corner(cell));
        if is_up == is_mirrored {
            self.surface.triangles.extend([[a, c, b], [a, d, c]]);
        } else {
            self.surface.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }

    /// The corner of a cell, named by its lowest voxel.
    fn corner(&mut self, cell: [i64; 3]) -> u32 {
        if let Some(corner) = self.corner_of.get(&cell) {
            return *corner;
        }
        let (mut sum, mut count) = (Vector3::zeros(), 0);
        for (axis, number) in (0..3).flat_map(|axis| (0..4).map(move |number| (axis, number))) {
            let mut from = cell;
            from[(axis + 1) % 3] += number % 2;
            from[(axis + 2) % 3] += number / 2;
            let mut to = from;
            to[axis] += 1;
            if self.holds(from) != self.holds(to) {
                let ends = Vector3::from(from.map(|n| n as f64)) + Vector3::from(to.map(|n| n as f64));
                sum += 0.5 * ends;
                count += 1;
            }
        }
        let place = sum / f64::from(count.max(1));
        let corner = self.surface.vertices.len() as u32;
        self.surface.vertices.push(self.first_m + self.edges_m * place);
        self.corner_of.insert(cell, corner);
        corner
    }
}
