//! A triangle mesh of the lumen, for recordings: rings swept along the centre line, with a cap at both ends.
//!
//! Vertex `i * sides + k` lies on ring `i` (`i` from 0 to `rings - 1`, evenly spaced in arc length) at the angle
//! `2π k / sides` from the normal of the rotation-minimising frame towards the binormal, at the radius asked of `radius(s, angle)`.
//! The last two vertices are the centres of the caps, oral and anal. Triangles turn counter-clockwise seen from outside.
//! Where the radius exceeds the bend radius of the centre line, rings cross on the inside of the bend.

use crate::tract::Tract;
use std::f64::consts::TAU;

/// A triangle mesh, torso frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TubeMesh {
    /// Vertices, m.
    pub vertices_m: Vec<[f32; 3]>,
    /// Corners of the triangles, indices of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Arc length of each vertex, m.
    pub arc_length_m: Vec<f32>,
}

/// Sweeps a tube along a tract; `radius(arc length in m, angle in rad)` in m. `rings` is raised to 2, `sides` to 3.
pub fn tube_mesh(tract: &Tract, rings: usize, sides: usize, radius: impl Fn(f64, f64) -> f64) -> TubeMesh {
    let (rings, sides) = (rings.max(2), sides.max(3));
    let mut mesh = TubeMesh::default();
    let mut push = |point: nalgebra::Point3<f64>, s: f64| {
        mesh.vertices_m.push([point.x as f32, point.y as f32, point.z as f32]);
        mesh.arc_length_m.push(s as f32);
    };
    let length_m = tract.length_m();
    for ring in 0..rings {
        let s = length_m * ring as f64 / (rings - 1) as f64;
        let station = tract.station(s);
        for side in 0..sides {
            let angle = TAU * side as f64 / sides as f64;
            let outward = station.normal * angle.cos() + station.binormal * angle.sin();
            push(station.position_m + outward * radius(s, angle), s);
        }
    }
    for s in [0.0, length_m] {
        push(tract.station(s).position_m, s);
    }
    mesh.triangles = triangles(rings as u32, sides as u32);
    mesh
}

fn triangles(rings: u32, sides: u32) -> Vec<[u32; 3]> {
    let at = |ring: u32, side: u32| ring * sides + side % sides;
    let (oral, anal) = (rings * sides, rings * sides + 1);
    let mut triangles = Vec::new();
    for side in 0..sides {
        for ring in 0..rings - 1 {
            let (a, b) = (at(ring, side), at(ring, side + 1));
            let (c, d) = (at(ring + 1, side), at(ring + 1, side + 1));
            triangles.push([a, b, c]);
            triangles.push([b, d, c]);
        }
        triangles.push([oral, at(0, side + 1), at(0, side)]);
        triangles.push([anal, at(rings - 1, side), at(rings - 1, side + 1)]);
    }
    triangles
}
