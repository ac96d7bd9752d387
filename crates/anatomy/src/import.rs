//! Import of a person's own gut: a surface (STL, OBJ, PLY) or a label volume (NIfTI, MetaImage) becomes a tract.
//!
//! | room | what it does |
//! |---|---|
//! | [`read`] | triangles from files |
//! | `volume` | the surface of a label volume |
//! | [`surface`] | edges, rims, orientation, volume |
//! | [`repair`], `walls` | what is wrong with a surface and what was done about it; walls with a thickness |
//! | `outline` | what the outer faces of walls drawn double still tell |
//! | `bvh`, `voxels` | nearest wall, rays, the inside as a graph that no step of can cross the wall |
//! | `path`, `chain`, [`middle`] | ends, the way between them, parts that do not meet, centre line and radius |
//! | [`contacts`] | where loops touch or are fused |
//! | [`organ`] | segments |
//! | `text` | the tract file, with provenance |
//!
//! One set of constants serves every surface; the only size that adapts is the voxel, a sixth of the lumen's mean radius
//! `2 V / A`. A [`Tract`] holds one radius per place, so the angle-dependent radius stays in [`ImportStation::rays_m`] and the tract has
//! its median, which a warning says.
//!
//! Neglected: lumina narrower than a voxel (0.2 to 3 mm) are closed; an end is led on straight to the wall.
//!
//! [`Tract`]: crate::tract::Tract

mod bvh;
mod chain;
pub mod contacts;
mod error;
pub mod middle;
pub mod organ;
mod outline;
mod path;
pub mod read;
pub mod repair;
pub mod surface;
mod text;
mod volume;
mod voxels;
mod walls;

pub use contacts::{Branch, SelfContact};
pub use error::ImportError;
pub use middle::ImportStation;
pub use organ::{Organ, SegmentStart};
pub use repair::{Repair, RepairKind};
pub use text::tract_file_text;

use crate::tract::{End, SegmentPoints, TractDraft, TractReport};
use crate::tract_file::Axes;
use bvh::Bvh;
use error::place;
use nalgebra::Point3;
use outline::Outline;
use path::{Pay, search};
use repair::Closure;
use sha2::{Digest as _, Sha256};
use std::path::Path;
use surface::Surface;
use voxels::Voxels;

/// Triangles of a surface: fewer describe no gut, more are decimated first.
const TRIANGLES: (usize, usize) = (100, 5_000_000);
/// The largest side of a gut's box, m: a piece of 5 cm to a tall person's whole tract.
pub(crate) const SIZE_M: (f64, f64) = (0.05, 1.2);
/// Mean radius of a lumen, m (medians of 5 to 23 mm in five people; an inflated stomach 60 mm).
pub(crate) const RADIUS_M: (f64, f64) = (0.002, 0.08);
/// Factors that a file's unit may have, m: micrometre, millimetre, centimetre, inch, decimetre, metre and their likely inversions.
const FACTORS: [f64; 9] = [1e-6, 1e-3, 1e-2, 0.0254, 0.1, 1.0, 10.0, 100.0, 1000.0];
/// What a gut's box usually measures, m.
const USUAL_SIZE_M: f64 = 0.35;
/// Voxels per mean radius.
const VOXELS_PER_RADIUS: f64 = 6.0;
/// A part of the lumen with less of all its voxels is a bubble.
const BUBBLE: f64 = 0.02;
/// Opening rims into a lumen may cost this part of the inside at most: the voxels that the closures cut.
const KEPT: f64 = 0.95;
/// With waypoints, a lumen that opens to the outside is followed where walls lie within so many mean radii all round.
const ENCLOSED_RADII: f64 = 6.0;
/// A waypoint may lie so far outside the lumen, m.
const WAYPOINT_M: f64 = 0.01;

/// What the user knows about a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Metres per unit of the file; of a label volume, whose format states millimetres, a further factor.
    pub factor: f64,
    /// Labels of the lumen in a label volume. Empty: the only one there is.
    pub labels: Vec<i64>,
    /// Which way the file's axes point; `None` takes those of the format (NIfTI: RAS, MetaImage: LPS), of a surface RAS, and says so.
    pub axes: Option<Axes>,
    /// The two ends and places between them, from mouth to anus, surface frame, m. One: the oral end, the other is found. Empty: both are found.
    pub waypoints_m: Vec<Point3<f64>>,
    /// Where segments begin. Empty: by proportion.
    pub starts: Vec<SegmentStart>,
    /// What is shown; `None` is decided from length and radius. Not used with `starts`.
    pub organ: Option<Organ>,
    /// The tract's name; `None` takes the file's.
    pub name: Option<String>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            factor: 1.0,
            labels: Vec::new(),
            axes: None,
            waypoints_m: Vec::new(),
            starts: Vec::new(),
            organ: None,
            name: None,
        }
    }
}

/// What an import is doing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// In words.
    pub stage: &'static str,
    /// Done of this stage, 0 to 1.
    pub done: f64,
}

/// What came out of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedTract {
    /// The tract, torso frame (RAS+).
    pub draft: TractDraft,
    /// What building it tells: bridges, overlaps.
    pub report: TractReport,
    /// Stations every 2 mm from mouth to anus, surface frame.
    pub stations: Vec<ImportStation>,
    /// First station of each segment.
    pub first_stations: Vec<usize>,
    /// Length of the built centre line, m.
    pub length_m: f64,
    /// Median of the radii along the line, m.
    pub median_radius_m: f64,
    /// What was changed.
    pub repairs: Vec<Repair>,
    /// What the user should know, in words.
    pub warnings: Vec<String>,
    /// Where the lumen meets itself.
    pub self_contacts: Vec<SelfContact>,
    /// What leads away from the line.
    pub branches: Vec<Branch>,
    /// Triangles before repairs, edge of the voxels (m), axes of the file.
    pub triangles: usize,
    /// Edge of the voxels, m.
    pub voxel_m: f64,
    /// Axes of the surface frame.
    pub axes: Axes,
    /// The file.
    pub file: String,
    /// SHA-256 of its bytes, hexadecimal; of a `.mhd` those of the header.
    pub sha256: String,
}

impl ImportedTract {
    /// Middle of the box around its centre line, torso frame, m.
    pub fn middle_m(&self) -> [f64; 3] {
        let mut ends = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for point in self.draft.segments.iter().flat_map(|segment| &segment.points_m) {
            for axis in 0..3 {
                ends[0][axis] = ends[0][axis].min(point[axis]);
                ends[1][axis] = ends[1][axis].max(point[axis]);
            }
        }
        [0, 1, 2].map(|axis| 0.5 * (ends[0][axis] + ends[1][axis]))
    }
}

/// Imports a surface, or the surface of a label volume.
///
/// # Errors
/// [`ImportError`], naming the file and the place.
pub fn import_surface(
    path: &Path,
    options: &ImportOptions,
    progress: &mut dyn FnMut(Progress),
) -> Result<ImportedTract, ImportError> {
    let file = path.display().to_string();
    progress(Progress { stage: "reading", done: 0.0 });
    let bytes = read::bytes_of(path)?;
    let sha256 = format!("{:x}", Sha256::digest(&bytes));
    let (mut surface, axes) = if volume::is_volume(path) {
        let (surface, axes) = volume::surface(path, &file, &options.labels)?;
        (surface, options.axes.or(Some(axes)))
    } else {
        let soup = read::soup(&bytes, &file)?;
        (Surface { vertices: soup.vertices, triangles: soup.triangles }, options.axes)
    };
    surface.vertices.iter_mut().for_each(|v| *v = Point3::from(v.coords * options.factor));
    Importer {
        file,
        sha256,
        options,
        progress,
        axes,
        warnings: Vec::new(),
        repairs: Vec::new(),
        bridges: middle::Bridges::default(),
        tail: Vec::new(),
    }
    .run(surface)
}

/// An import under way.
struct Importer<'a> {
    file: String,
    sha256: String,
    options: &'a ImportOptions,
    progress: &'a mut dyn FnMut(Progress),
    axes: Option<Axes>,
    warnings: Vec<String>,
    repairs: Vec<Repair>,
    bridges: middle::Bridges,
    /// Places of the way beyond the ends of an inner face, m.
    tail: Vec<Point3<f64>>,
}

impl Importer<'_> {
    fn run(mut self, mut surface: Surface) -> Result<ImportedTract, ImportError> {
        let triangles = surface.triangles.len();
        self.check_count(triangles)?;
        self.check_size(&surface)?;
        self.tell("repairing", 0.0);
        let (radius_m, closures, outline) = self.repair(&mut surface)?;
        self.tell("voxels", 0.0);
        let mut voxels = Voxels::new(&surface, radius_m / VOXELS_PER_RADIUS);
        let closed = surface.clone();
        if self.open_inner_rims(&mut surface, &voxels, &closures) {
            let opened = Voxels::new(&surface, radius_m / VOXELS_PER_RADIUS);
            // Two closures with lumen between them may both have led outside by way of each other.
            if opened.inside.len() as f64 >= KEPT * voxels.inside.len() as f64 {
                voxels = opened;
            } else {
                surface = closed;
                closures.iter().for_each(|closure| self.repairs[closure.repair].kind = RepairKind::Closed);
            }
        }
        let is_guided = self.is_guided();
        if is_guided {
            voxels.enclose(ENCLOSED_RADII * radius_m);
        }
        let tree = Bvh::new(&surface);
        let progress = &mut *self.progress;
        voxels.measure(&tree, |done| progress(Progress { stage: "clearance", done }));
        self.tell("way", 0.0);
        let outer = outline.as_ref().map(|outline| outline.voxels(voxels.edge_m));
        let way = self.way(&voxels, outer.as_ref(), radius_m)?;
        let tree = match &outline {
            Some(outline) if !self.tail.is_empty() => Bvh::new(&outline.led_on_surface(&surface, &self.tail)),
            _ => tree,
        };
        let has_ends = [!self.options.waypoints_m.is_empty(), is_guided];
        let progress = &mut *self.progress;
        let mut stations =
            middle::centre_line(&tree, outline.as_ref(), &way, &self.bridges, has_ends, |done| {
                progress(Progress { stage: "centre line", done });
            });
        self.check_tube(&stations, radius_m)?;
        if self.options.waypoints_m.is_empty() {
            self.turn(&mut stations);
        }
        self.tell("contacts", 0.0);
        let (self_contacts, branches) = contacts::find(&voxels, &stations);
        self.finish(stations, self_contacts, branches, triangles, voxels.edge_m)
    }

    /// Whether the user names both ends.
    fn is_guided(&self) -> bool {
        self.options.waypoints_m.len() > 1
    }

    fn tell(&mut self, stage: &'static str, done: f64) {
        (self.progress)(Progress { stage, done });
    }

    fn check_count(&self, count: usize) -> Result<(), ImportError> {
        let (low, high) = TRIANGLES;
        if (low..=high).contains(&count) {
            return Ok(());
        }
        Err(ImportError::Triangles { file: self.file.clone(), count, low, high })
    }

    /// Refuses a box that is no gut's, with the factors that would make it one.
    fn check_size(&self, surface: &Surface) -> Result<(), ImportError> {
        let (low, high) = surface.bounds();
        let size_m = (high - low).max();
        if size_m >= SIZE_M.0 && size_m <= SIZE_M.1 {
            return Ok(());
        }
        Err(self.unit_error(size_m, 0.0))
    }

    fn unit_error(&self, size_m: f64, radius_m: f64) -> ImportError {
        let factor = self.options.factor;
        // The one that was tried is none.
        let others = FACTORS.into_iter().filter(|f| (f / factor - 1.0).abs() > 1e-9);
        let mut suggestions: Vec<(f64, f64)> = others.map(|f| (f, size_m / factor * f)).collect();
        let misfit = |size_m: f64| (size_m / USUAL_SIZE_M).ln().abs();
        suggestions.sort_by(|a, b| misfit(a.1).total_cmp(&misfit(b.1)));
        suggestions.truncate(3);
        ImportError::Unit { file: self.file.clone(), size_m, radius_m, factor, suggestions }
    }

    /// Repairs the surface; its mean radius, m, and the outer faces of its walls.
    fn repair(&mut self, surface: &mut Surface) -> Result<(f64, Vec<Closure>, Option<Outline>), ImportError> {
        let at_m = surface.middle();
        let is_guided = self.is_guided();
        let repaired = repair::repair(surface, is_guided).map_err(|open| ImportError::Open {
            file: self.file.clone(),
            at_m: open.at_m,
            edges: open.edges,
            diameter_mm: 1e3 * open.diameter_m,
            limit_mm: 1e3 * open.limit_m,
        })?;
        let repair::Repaired { repairs, closures, outline } = repaired;
        self.repairs = repairs;
        let radius_m = repair::mean_radius_m(surface);
        self.check_walls(surface, radius_m)?;
        let (low, high) = surface.bounds();
        let size_m = (high - low).max();
        // Flat: the volume is what rounding leaves.
        if radius_m.is_nan() || radius_m <= 1e-3 * RADIUS_M.0 {
            let reason = format!("its volume is {:.2e} m3", surface.volume_m3());
            return Err(ImportError::NoInside { file: self.file.clone(), at_m, reason });
        }
        if radius_m < RADIUS_M.0 || radius_m > RADIUS_M.1 {
            return Err(self.unit_error(size_m, radius_m));
        }
        Ok((radius_m, closures, Outline::of(outline)))
    }

    /// Refuses, or with waypoints warns of, what still looks like walls with a thickness: the line would run within them.
    fn check_walls(&mut self, surface: &Surface, radius_m: f64) -> Result<(), ImportError> {
        let Some(walls::Suspicion { at_m, part }) = walls::suspicion(surface, radius_m) else {
            return Ok(());
        };
        let error = ImportError::Wall { file: self.file.clone(), at_m, percent: 100.0 * part };
        if !self.is_guided() {
            return Err(error);
        }
        self.warnings.push(error.to_string());
        Ok(())
    }

    /// Takes out closures with lumen on both sides: there a lumen opens into another. Whether there were any.
    fn open_inner_rims(&mut self, surface: &mut Surface, voxels: &Voxels, closures: &[Closure]) -> bool {
        let is_lumen = |p: Point3<f64>| voxels.index_of(&p).is_some_and(|index| voxels.is_inside(index));
        let mut gone = vec![false; surface.triangles.len()];
        for closure in closures {
            let has_lumen_on_both_sides = |t: &usize| {
                // A voxel and a half to both sides is beyond the voxels that the closure itself cuts.
                let step = surface::unit_or_zero(surface.vector_area(*t)) * (1.5 * voxels.edge_m);
                is_lumen(surface.centroid(*t) + step) && is_lumen(surface.centroid(*t) - step)
            };
            let inner = closure.triangles.clone().filter(has_lumen_on_both_sides).count();
            if 2 * inner > closure.triangles.len() {
                gone[closure.triangles.clone()].fill(true);
                self.repairs[closure.repair].kind = RepairKind::LeftOpen;
            }
        }
        let is_any = gone.contains(&true);
        if is_any {
            *surface = surface.part(|t| !gone[t]);
        }
        is_any
    }

    /// The row of places through the lumen, from end to end.
    fn way(
        &mut self,
        voxels: &Voxels,
        outer: Option<&Voxels>,
        radius_m: f64,
    ) -> Result<Vec<Point3<f64>>, ImportError> {
        let parts = path::parts(voxels);
        let Some(largest) = parts.first() else {
            let reason = format!("no voxel of {:.2} mm lies inside", 1e3 * voxels.edge_m);
            let at_m = voxels.place_m(voxels.len() / 2);
            return Err(ImportError::NoInside { file: self.file.clone(), at_m, reason });
        };
        if self.is_guided() {
            return self.way_through(voxels, outer, radius_m);
        }
        let total = voxels.inside.len() as f64;
        let large: Vec<_> = parts.iter().filter(|part| part.voxels as f64 >= BUBBLE * total).collect();
        if large.len() > 1 && self.options.waypoints_m.len() == 1 {
            return Err(ImportError::WaypointCount { file: self.file.clone(), count: 1 });
        }
        if large.len() > 1 {
            let has_walls = self.repairs.iter().any(|repair| repair.kind == RepairKind::ThickWall);
            if let Some((way, joints)) = chain::chain(voxels, &parts, large.len(), radius_m, has_walls) {
                self.repairs.extend(joints.iter().map(|joint| Repair {
                    kind: RepairKind::Parts,
                    at_m: joint.middle_m(),
                    size_m: joint.length_m(),
                    count: 1,
                }));
                let pieces_m = joints.into_iter().flat_map(|joint| joint.pieces_m).collect();
                self.bridges = middle::Bridges { pieces_m, reach_m: radius_m };
                return Ok(way);
            }
            let volume_ml = |voxels_in: usize| 1e6 * voxels.edge_m.powi(3) * voxels_in as f64;
            let parts = large.iter().map(|part| (part.middle_m, volume_ml(part.voxels))).collect();
            return Err(ImportError::SeveralParts { file: self.file.clone(), parts });
        }
        let (from, to) = match self.options.waypoints_m[..] {
            [] => path::furthest_pair(voxels, largest.seed, radius_m),
            _ => self.ends_after_first(voxels, radius_m)?,
        };
        let ends_m = [from, to].map(|index| voxels.place_m(index));
        let is_given = !self.options.waypoints_m.is_empty();
        let tails = [(ends_m, !is_given), ([ends_m[1], ends_m[0]], true)].map(|(ends_m, is_found)| {
            let outer = outer.filter(|_| is_found);
            outer.and_then(|outer| outline::tail(outer, voxels, ends_m, radius_m)).unwrap_or_default()
        });
        let entry = |tail: &[Point3<f64>], end: usize| {
            tail.last().and_then(|place| voxels.index_of(place)).unwrap_or(end)
        };
        let (from, to) = (entry(&tails[0], from), entry(&tails[1], to));
        let reach = search(voxels, from, Some(to), Pay::Middle { radius_m });
        let way = reach.way_to(voxels, to).into_iter().map(|index| voxels.place_m(index)).collect();
        Ok(self.with_tails(way, tails))
    }

    /// The end that the user names and the one found from there.
    fn ends_after_first(&mut self, voxels: &Voxels, radius_m: f64) -> Result<(usize, usize), ImportError> {
        let from = self.stop(voxels, radius_m, 0, &self.options.waypoints_m[0], true)?;
        let to = search(voxels, from, None, Pay::Reach { radius_m }).last;
        let to = path::led_on(voxels, from, to, radius_m);
        let anal = place(&voxels.place_m(to));
        self.warnings.push(format!("the anal end was found, not given: near {anal} mm"));
        Ok((from, to))
    }

    /// A way with what lies beyond its ends, and tells of it.
    fn with_tails(&mut self, way: Vec<Point3<f64>>, tails: [Vec<Point3<f64>>; 2]) -> Vec<Point3<f64>> {
        for tail in tails.iter().filter(|tail| !tail.is_empty()) {
            let at_m = tail[tail.len() - 1];
            let size_m = middle::chords_m(tail);
            self.repairs.push(Repair { kind: RepairKind::OuterFace, at_m, size_m, count: tail.len() });
            self.tail.extend(tail);
        }
        let [oral, anal] = tails;
        oral.into_iter().chain(way).chain(anal.into_iter().rev()).collect()
    }

    /// What leads from an end that the user names within the outer face alone to the lumen; empty where it is in the lumen.
    fn tail_from(
        voxels: &Voxels,
        outer: Option<&Voxels>,
        [end_m, other_m]: [Point3<f64>; 2],
        radius_m: f64,
    ) -> Vec<Point3<f64>> {
        let is_near = |voxels: &Voxels| {
            path::nearest_inside(voxels, &end_m).filter(|(_, away_m)| *away_m <= WAYPOINT_M)
        };
        let Some(outer) = outer.filter(|_| is_near(voxels).is_none()) else { return Vec::new() };
        let (from, towards) = (is_near(outer), path::nearest_inside(outer, &other_m));
        let way = from.zip(towards).and_then(|((from, _), (towards, _))| {
            outline::into_lumen(outer, voxels, from, towards, radius_m)
        });
        way.unwrap_or_default()
    }

    fn way_through(
        &mut self,
        voxels: &Voxels,
        outer: Option<&Voxels>,
        radius_m: f64,
    ) -> Result<Vec<Point3<f64>>, ImportError> {
        let mut waypoints = self.options.waypoints_m.clone();
        let last = waypoints.len() - 1;
        let tails = [[0, last.min(1)], [last, last.saturating_sub(1)]]
            .map(|ends| Self::tail_from(voxels, outer, ends.map(|i| waypoints[i]), radius_m));
        for (tail, end) in tails.iter().zip([0, last]) {
            waypoints[end] = tail.last().copied().unwrap_or(waypoints[end]);
        }
        let stops = self.stops(&waypoints, voxels, radius_m)?;
        let mut way = vec![stops[0]];
        for pair in stops.windows(2) {
            let mut reach = search(voxels, pair[0], Some(pair[1]), Pay::Middle { radius_m });
            if !reach.is_reached(pair[1]) {
                reach = search(voxels, pair[0], Some(pair[1]), Pay::MiddleThroughWalls { radius_m });
            }
            if !reach.is_reached(pair[1]) {
                let (from_m, to_m) = (voxels.place_m(pair[0]), voxels.place_m(pair[1]));
                return Err(ImportError::NoWay { file: self.file.clone(), from_m, to_m });
            }
            way.extend(&reach.way_to(voxels, pair[1])[1..]);
        }
        self.list_passages(voxels, &way);
        let way = way.into_iter().map(|index| voxels.place_m(index)).collect();
        Ok(self.with_tails(way, tails))
    }

    /// The voxels of the waypoints; those between the ends moved to the middle of the lumen.
    fn stops(
        &self,
        waypoints: &[Point3<f64>],
        voxels: &Voxels,
        radius_m: f64,
    ) -> Result<Vec<usize>, ImportError> {
        let last = waypoints.len() - 1;
        let stop = |(index, at_m)| self.stop(voxels, radius_m, index, at_m, index == 0 || index == last);
        waypoints.iter().enumerate().map(stop).collect()
    }

    /// The voxel of a waypoint. The ends are where the user says, what lies between only tells the way.
    fn stop(
        &self,
        voxels: &Voxels,
        radius_m: f64,
        index: usize,
        at_m: &Point3<f64>,
        is_end: bool,
    ) -> Result<usize, ImportError> {
        let nearest = path::nearest_inside(voxels, at_m).filter(|_| at_m.iter().all(|v| v.is_finite()));
        match nearest {
            Some((voxel, distance_m)) if distance_m <= WAYPOINT_M => {
                Ok(if is_end { voxel } else { path::to_the_middle(voxels, voxel, radius_m) })
            }
            _ => Err(ImportError::Waypoint {
                file: self.file.clone(),
                index,
                at_m: *at_m,
                distance_mm: 1e3 * nearest.map_or(f64::INFINITY, |(_, distance_m)| distance_m),
                limit_mm: 1e3 * WAYPOINT_M,
            }),
        }
    }

    /// Lists where the way leads through walls.
    fn list_passages(&mut self, voxels: &Voxels, way: &[usize]) {
        let is_open = |a: usize, b: usize| {
            voxels::STEPS.iter().any(|step| voxels.open_neighbour(a, *step) == Some(b)) && voxels.is_inside(a)
        };
        let closed: Vec<usize> = (1..way.len()).filter(|i| !is_open(way[i - 1], way[*i])).collect();
        for run in closed.chunk_by(|a, b| a + 1 == *b) {
            let (Some(from), Some(to)) = (run.first(), run.last()) else { continue };
            let (a, b) = (voxels.place_m(way[from - 1]), voxels.place_m(way[*to]));
            self.repairs.push(Repair {
                kind: RepairKind::Passage,
                at_m: nalgebra::center(&a, &b),
                size_m: (b - a).norm(),
                count: run.len(),
            });
        }
    }

    fn check_tube(&self, stations: &[ImportStation], radius_m: f64) -> Result<(), ImportError> {
        let length_m = length_m(stations);
        if stations.len() >= 8 && length_m > 4.0 * radius_m {
            return Ok(());
        }
        let (length_mm, width_mm) = (1e3 * length_m, 2e3 * radius_m);
        Err(ImportError::NoTube { file: self.file.clone(), length_mm, width_mm })
    }

    /// Begins the line at its upper end.
    fn turn(&mut self, stations: &mut [ImportStation]) {
        let (first, last) = (stations[0].point_m, stations[stations.len() - 1].point_m);
        if last.z > first.z {
            stations.reverse();
        }
        let (oral, anal) = (stations[0].point_m, stations[stations.len() - 1].point_m);
        self.warnings.push(format!(
            "the ends were found, not given; the upper one (larger z), {} mm, is taken as oral, {} mm as anal",
            place(&oral),
            place(&anal)
        ));
    }

    fn finish(
        mut self,
        stations: Vec<ImportStation>,
        self_contacts: Vec<SelfContact>,
        branches: Vec<Branch>,
        triangles: usize,
        voxel_m: f64,
    ) -> Result<ImportedTract, ImportError> {
        let median_radius_m = median_radius_m(&stations);
        let segments = self.segments(&stations, median_radius_m)?;
        let axes = self.axes.unwrap_or(Axes::Ras);
        if self.axes.is_none() {
            self.warnings.push(
                "the file's axes were not stated; taken as RAS (x right, y anterior, z superior)".to_owned(),
            );
        }
        self.warnings.push(
            "a tract holds one radius per place: the median of 24 directions; the others are with the stations".to_owned(),
        );
        self.warn_of(&self_contacts, &branches);
        let draft = self.draft(&stations, &segments, axes);
        let at_file = |error| ImportError::Tract { file: self.file.clone(), error };
        let (tract, report) = draft.clone().build().map_err(at_file)?;
        self.warnings.extend(report.warnings.iter().cloned());
        Ok(ImportedTract {
            length_m: tract.length_m(),
            first_stations: segments.iter().map(|(_, station)| *station).collect(),
            draft,
            report,
            stations,
            median_radius_m,
            repairs: self.repairs,
            warnings: self.warnings,
            self_contacts,
            branches,
            triangles,
            voxel_m,
            axes,
            file: self.file,
            sha256: self.sha256,
        })
    }

    fn segments(
        &mut self,
        stations: &[ImportStation],
        radius_m: f64,
    ) -> Result<Vec<(crate::SegmentKey, usize)>, ImportError> {
        if !self.options.starts.is_empty() {
            self.warnings.push(
                "segments are those that were named; what else the line passes is told as part of them"
                    .to_owned(),
            );
            return organ::named(&self.options.starts, stations, &self.file);
        }
        let organ = self.options.organ.unwrap_or_else(|| {
            let organ = Organ::of(length_m(stations), radius_m);
            let name = organ.name();
            self.warnings
                .push(format!("the organ was not stated; by length over radius it is taken for a {name}"));
            organ
        });
        self.warnings.push(
            "segments begin where proportions of two people put them, not at this person's landmarks: name the places"
                .to_owned(),
        );
        Ok(organ.divided(stations.len()))
    }

    fn warn_of(&mut self, contacts: &[SelfContact], branches: &[Branch]) {
        for contact in contacts.iter().filter(|contact| contact.is_fused) {
            self.warnings.push(format!(
                "handle: the lumen is fused with itself at {} mm ({:.0} and {:.0} mm along the line, {:.0} mm2); if the line \
                 takes a short cut there, give waypoints",
                place(&contact.place_m),
                1e3 * contact.at_m.0,
                1e3 * contact.at_m.1,
                1e6 * contact.area_m2
            ));
        }
        for branch in branches {
            self.warnings.push(format!(
                "branch: the lumen leads {:.0} mm away from the line, {:.0} mm along it, to {} mm",
                1e3 * branch.length_m,
                1e3 * branch.at_m,
                place(&branch.tip_m)
            ));
        }
    }

    fn draft(
        &self,
        stations: &[ImportStation],
        segments: &[(crate::SegmentKey, usize)],
        axes: Axes,
    ) -> TractDraft {
        let source = text::source(&self.file, &self.sha256);
        let of = |(number, (key, first)): (usize, &(crate::SegmentKey, usize))| {
            // The last station of a segment is the first of the next.
            let last = segments.get(number + 1).map_or(stations.len() - 1, |(_, next)| *next);
            let part = &stations[*first..=last];
            SegmentPoints {
                key: *key,
                points_m: part.iter().map(|s| axes.torso_from_file(s.point_m)).collect(),
                radii_m: part.iter().map(|s| s.radius_m).collect(),
                wall: key.default_wall(),
                source: source.clone(),
            }
        };
        let stem = Path::new(&self.file).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        TractDraft {
            name: self.options.name.clone().or(stem).unwrap_or_else(|| "imported".to_owned()),
            segments: segments.iter().enumerate().map(of).collect(),
            ends: (End::Closed, End::Exit),
            torso_half_extents_m: None,
            source,
        }
    }
}

fn length_m(stations: &[ImportStation]) -> f64 {
    stations.windows(2).map(|pair| (pair[1].point_m - pair[0].point_m).norm()).sum()
}

fn median_radius_m(stations: &[ImportStation]) -> f64 {
    let mut radii: Vec<f64> = stations.iter().map(|s| s.radius_m).collect();
    radii.sort_unstable_by(f64::total_cmp);
    radii.get(radii.len() / 2).copied().unwrap_or(0.0)
}
