//! The markers in the capsule: `[[marker]]` of a capsule's model.
//!
//! Both sides know where the markers were put; where they really are, and how active they really are, is the world's business.
//! The reference triangle of than2015 has sides of 10, 13 and 13 mm: its mirror image about the apex is itself, so a turn by
//! 180 degrees about the capsule's axis cannot be told from an exchange of the two base markers ([`MarkerSet::symmetries`]).

use crate::simulation::Shell;
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{ConfigError, Name, Node};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// `[[marker]]` of a capsule model.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerTable {
    /// Position in the capsule's frame, mm.
    pub position_mm: [Finite; 3],
    /// Activity at the scenario's start, MBq.
    pub activity_mbq: Positive,
    /// Name of an isotope in `models/isotopes`, or a path.
    pub isotope: String,
    /// Diameter of the active core, mm.
    pub core_diameter_mm: Positive,
    /// What surrounds the core; absent: nothing that stops a positron.
    pub shell: Option<ShellTable>,
    /// Where the numbers come from.
    pub source: String,
}

/// `shell` of a marker: acrylic 1.18, titanium 4.51, gold 19.3, tungsten 19.3 g/cm³.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShellTable {
    /// Thickness, mm.
    pub thickness_mm: Positive,
    /// Density, g/cm³: positrons are stopped by mass.
    pub density_g_cm3: Positive,
}

/// `[capsule]` of the model, as far as markers must fit in.
#[derive(Clone, Copy, Debug, Deserialize)]
struct BodyTable {
    diameter_mm: Positive,
    length_mm: Positive,
}

impl BodyTable {
    /// How far a place lies outside the capsule, along whose frame's x a cylinder with two half spheres lies, mm; negative inside.
    fn outside_mm(&self, place_mm: &Vector3<f64>) -> f64 {
        let (radius_mm, length_mm) = (0.5 * self.diameter_mm.0, self.length_mm.0);
        let half_axis_mm = (0.5 * length_mm - radius_mm).max(0.0);
        let beyond_mm = (place_mm.x.abs() - half_axis_mm).max(0.0);
        Vector3::new(beyond_mm, place_mm.y, place_mm.z).norm() - radius_mm
    }
}

/// One marker as installed.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Position in the capsule's frame, m.
    pub position_capsule_m: Vector3<f64>,
    /// Activity at the scenario's start, Bq.
    pub activity_bq: f64,
    /// Isotope, as the model names it.
    pub isotope: Name,
    /// Diameter of the active core, m.
    pub core_diameter_m: f64,
    /// What surrounds the core.
    pub shell: Option<Shell>,
}

/// Markers nearer to each other than this stand at one place: no scanner separates half a millimetre.
pub const SAME_PLACE_M: f64 = 5e-4;
/// Markers whose smallest spread across a line (root of the second eigenvalue of their scatter) is below this lie on a line.
pub const COLLINEAR_M: f64 = 5e-4;
/// Density of osmium, the densest of all elements, g/cm³.
const DENSEST_G_CM3: f64 = 22.59;
/// Rounding of a marker that touches the surface, mm.
const TOUCHES_MM: f64 = 1e-6;
/// More markers than this are a typing error.
const MAX_MARKERS: usize = 32;

/// All markers of a capsule.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerSet {
    /// The markers, in the file's order.
    pub markers: Vec<Marker>,
}

impl MarkerSet {
    /// Reads `[[marker]]` of a capsule's model file: at least `least` of them, each within the capsule, no two at one place, three or more
    /// not on a line.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key; a capsule without markers says so.
    pub fn from_capsule(capsule: &Node, sensor: &str, least: usize) -> Result<Self, ConfigError> {
        let nodes = capsule.children("marker").unwrap_or_default();
        if nodes.is_empty() {
            let message = format!("sensor `{sensor}` tracks PET markers, but this capsule has no [[marker]]");
            return Err(capsule.error(&message));
        }
        let body: Option<BodyTable> =
            capsule.child("capsule").map(|body| body.parse_quietly()).transpose()?;
        let mut markers: Vec<Marker> = Vec::new();
        for node in &nodes {
            let table: MarkerTable = node.parse()?;
            check_fit(&table, body.as_ref(), node)?;
            let position = Vector3::from(table.position_mm.map(|v| v.0)) * 1e-3;
            if let Some(same) =
                markers.iter().position(|m| (m.position_capsule_m - position).norm() < SAME_PLACE_M)
            {
                let message = format!(
                    "this marker stands where marker {} stands; allowed: at least 0.5 mm apart",
                    same + 1
                );
                return Err(node.error_at("position_mm", &message));
            }
            markers.push(Marker {
                position_capsule_m: position,
                activity_bq: table.activity_mbq.0 * 1e6,
                isotope: Name::from(table.isotope.as_str()),
                core_diameter_m: table.core_diameter_mm.0 * 1e-3,
                // Relative to water.
                shell: table.shell.map(|shell| Shell {
                    thickness_m: shell.thickness_mm.0 * 1e-3,
                    relative_density: shell.density_g_cm3.0,
                }),
            });
        }
        let set = Self { markers };
        let last = &nodes[nodes.len() - 1];
        if nodes.len() < least || nodes.len() > MAX_MARKERS {
            let message = format!("{} markers; allowed: {least} to {MAX_MARKERS}", nodes.len());
            return Err(last.error(&message));
        }
        if nodes.len() >= 3 && set.are_collinear() {
            let message = "all markers lie on a line, so the turn about it cannot be seen; move one at least 1 mm off it";
            return Err(last.error_at("position_mm", message));
        }
        Ok(set)
    }

    /// Number of markers.
    pub fn len(&self) -> usize {
        self.markers.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.markers.is_empty()
    }

    /// Positions in the capsule's frame, m.
    pub fn positions_capsule_m(&self) -> Vec<Vector3<f64>> {
        self.markers.iter().map(|m| m.position_capsule_m).collect()
    }

    /// Centroid in the capsule's frame, m.
    pub fn centroid_capsule_m(&self) -> Vector3<f64> {
        self.markers.iter().map(|m| m.position_capsule_m).sum::<Vector3<f64>>() / self.len().max(1) as f64
    }

    /// Activity of all markers, Bq.
    pub fn total_activity_bq(&self) -> f64 {
        self.markers.iter().map(|m| m.activity_bq).sum()
    }

    /// Whether fewer than two directions of spread are larger than [`COLLINEAR_M`].
    pub fn are_collinear(&self) -> bool {
        let centre = self.centroid_capsule_m();
        let offsets = self.markers.iter().map(|m| m.position_capsule_m - centre);
        let scatter: Matrix3<f64> =
            offsets.map(|o| o * o.transpose()).sum::<Matrix3<f64>>() / self.len().max(1) as f64;
        let mut spread: Vec<f64> =
            scatter.symmetric_eigenvalues().iter().map(|v| v.max(0.0).sqrt()).collect();
        spread.sort_by(f64::total_cmp);
        spread[1] < COLLINEAR_M
    }

    /// Proper rotations about the centroid, other than none, that map the set onto itself within `tolerance_m` while activities
    /// agree within `activity_tolerance` (relative): poses that the lines cannot tell apart. Each comes with the order in which the
    /// markers then stand.
    pub fn symmetries(&self, tolerance_m: f64, activity_tolerance: f64) -> Vec<(Vec<usize>, Rotation3<f64>)> {
        let n = self.len();
        let mut found = Vec::new();
        for order in permutations(n) {
            if order.iter().enumerate().all(|(i, j)| i == *j) {
                continue;
            }
            let alike = order.iter().enumerate().all(|(i, j)| {
                let (a, b) = (self.markers[i].activity_bq, self.markers[*j].activity_bq);
                (a - b).abs() <= activity_tolerance * a.max(b)
            });
            let (turn, worst) = self.best_rotation(&order);
            if alike && worst <= tolerance_m {
                found.push((order, turn));
            }
        }
        found
    }

    /// The rotation about the centroid that brings marker `i` nearest to marker `order[i]`, in the least-squares sense (Kabsch 1976),
    /// and the largest distance that is left, m.
    pub fn best_rotation(&self, order: &[usize]) -> (Rotation3<f64>, f64) {
        let centre = self.centroid_capsule_m();
        let arm = |i: usize| self.markers[i].position_capsule_m - centre;
        let mut cross = Matrix3::zeros();
        for (i, j) in order.iter().enumerate() {
            cross += arm(*j) * arm(i).transpose();
        }
        let svd = cross.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return (Rotation3::identity(), f64::INFINITY) };
        let sign = (u * v_t).determinant().signum();
        let turn =
            Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t);
        let left = order.iter().enumerate().map(|(i, j)| (turn * arm(i) - arm(*j)).norm());
        let worst = left.fold(0.0, f64::max);
        (turn, worst)
    }
}

/// All orders of `n` things, the given one first; of more than six only that one (720 orders are enough to look at).
fn permutations(n: usize) -> Vec<Vec<usize>> {
    let mut all = vec![(0..n).collect::<Vec<_>>()];
    if n > 6 {
        return all;
    }
    let mut current: Vec<usize> = (0..n).collect();
    // Narayana's next permutation in lexicographic order.
    while let Some(i) = (1..n).rev().find(|i| current[i - 1] < current[*i]) {
        let j = (i..n).rev().find(|j| current[*j] > current[i - 1]).unwrap_or(i);
        current.swap(i - 1, j);
        current[i..].reverse();
        all.push(current.clone());
    }
    all
}

/// Refuses a marker that no capsule could hold.
fn check_fit(marker: &MarkerTable, body: Option<&BodyTable>, node: &Node) -> Result<(), ConfigError> {
    let mut radius_mm = 0.5 * marker.core_diameter_mm.0;
    if let Some(shell) = &marker.shell {
        radius_mm += shell.thickness_mm.0;
        let density = shell.density_g_cm3.0;
        if density > DENSEST_G_CM3 {
            let message = format!("{density} g/cm³; allowed: up to {DENSEST_G_CM3} (osmium)");
            return Err(node.error_at("shell", &message));
        }
    }
    let Some(body) = body else { return Ok(()) };
    let place_mm = Vector3::from(marker.position_mm.map(|v| v.0));
    let outside_mm = body.outside_mm(&place_mm) + radius_mm;
    if outside_mm > TOUCHES_MM {
        let message = format!(
            "this marker of {radius_mm} mm radius stands {outside_mm:.2} mm out of the capsule; allowed: within its {} x {} mm",
            body.diameter_mm.0, body.length_mm.0
        );
        return Err(node.error_at("position_mm", &message));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(places_mm: &[[f64; 3]]) -> MarkerSet {
        let marker = |p: &[f64; 3]| Marker {
            position_capsule_m: Vector3::from(*p) * 1e-3,
            activity_bq: 1.85e6,
            isotope: Name::from("na-22"),
            core_diameter_m: 5e-4,
            shell: None,
        };
        MarkerSet { markers: places_mm.iter().map(marker).collect() }
    }

    #[test]
    fn closed_form_symmetries_of_triangles() {
        let isosceles = set(&[[-12.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, -5.0, 0.0]]);
        let found = isosceles.symmetries(1e-4, 0.05);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].0, vec![0, 2, 1]);
        // A half turn about the capsule's axis.
        assert!((found[0].1.angle() - std::f64::consts::PI).abs() < 1e-9);
        assert!((found[0].1 * Vector3::x() - Vector3::x()).norm() < 1e-9);
        let scalene = set(&[[-12.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, -3.0, 0.0]]);
        assert!(scalene.symmetries(1e-4, 0.05).is_empty());
        let equilateral =
            set(&[[1.0, 0.0, 0.0], [-0.5, 0.75_f64.sqrt(), 0.0], [-0.5, -(0.75_f64.sqrt()), 0.0]]);
        assert_eq!(equilateral.symmetries(1e-4, 0.05).len(), 5);
    }

    #[test]
    fn closed_form_collinear_markers_are_found() {
        assert!(set(&[[0.0; 3], [5.0, 5.0, 0.0], [10.0, 10.0, 0.0]]).are_collinear());
        assert!(!set(&[[0.0; 3], [5.0, 5.0, 0.0], [10.0, 0.0, 0.0]]).are_collinear());
    }
    #[test]
    fn law_a_marker_that_no_capsule_holds_is_refused() {
        let capsule = |x: f64, y: f64, core: f64, shell: &str| {
            let text = format!(
                "[capsule]\ndiameter_mm = 12.0\nlength_mm = 26.0\n[[marker]]\nposition_mm = [{x}, {y}, 0.0]\nactivity_mbq = 1.0\n\
                 isotope = \"na-22\"\ncore_diameter_mm = {core}\n{shell}source = \"test\"\n"
            );
            let node = Node::parse_text(&text, "c.toml", std::path::Path::new(""), &[]).unwrap();
            MarkerSet::from_capsule(&node, "pet", 1).map_err(|error| error.to_string())
        };
        let shell = |thickness: f64, density: f64| {
            format!("shell = {{ thickness_mm = {thickness}, density_g_cm3 = {density} }}\n")
        };
        for (x, y, core, shell) in [
            (0.0, 5.75, 0.5, String::new()),
            (-12.75, 0.0, 0.5, String::new()),
            (7.0, 5.0, 0.5, shell(0.75, 19.3)),
        ] {
            capsule(x, y, core, &shell).unwrap();
        }
        for (x, y, core, shell, wanted) in [
            (
                0.0,
                5.8,
                0.5,
                String::new(),
                "c.toml:5:15: `marker[0].position_mm`: this marker of 0.25 mm radius stands 0.05 mm out",
            ),
            (
                0.0,
                -40.0,
                0.5,
                String::new(),
                "stands 34.25 mm out of the capsule; allowed: within its 12 x 26 mm",
            ),
            (-12.9, 0.0, 0.5, String::new(), "stands 0.15 mm out"),
            (12.0, 5.0, 0.5, String::new(), "stands 1.32 mm out"),
            (0.0, 5.0, 0.5, shell(1.0, 1.18), "stands 0.25 mm out"),
            (0.0, 0.0, 0.5, shell(1.0, 1930.0), "1930 g/cm³; allowed: up to 22.59"),
        ] {
            let message = capsule(x, y, core, &shell).unwrap_err();
            assert!(message.contains(wanted), "{message}");
        }
    }
}
