//! From what a plugin draws to what the viewer draws.
//!
//! Meshes get smooth normals (the area-weighted mean over a vertex's triangles), without which the viewer cannot shade
//! them. Meshes of the world (tract, body, bed) are drawn see-through where their colour is opaque: what is in them is
//! what matters. A thing that is drawn again unchanged costs nothing: it is recognised by a hash of its content.

use crate::geometry::transform;
use crate::palette::with_alpha;
use lumenav_core::{FixKind, Primitive};
use lumenav_pipeline::SceneOwner;
use rerun::{AsComponents, Color, SerializedComponentBatch};

/// Opacity of an opaque world mesh, of 255.
const WORLD_MESH_ALPHA: u8 = 0x46;
/// Radius of lines in the scene, in points of the screen (they stay visible at every zoom).
const LINE_POINTS: f32 = 1.2;
/// Radius of arrows' shafts, in points of the screen.
const ARROW_POINTS: f32 = 1.5;

/// Where a primitive is shown.
pub(crate) fn path(owner: &SceneOwner, primitive: &Primitive) -> String {
    let relative = match primitive {
        Primitive::Points { path, .. }
        | Primitive::Lines { path, .. }
        | Primitive::Arrows { path, .. }
        | Primitive::Mesh { path, .. }
        | Primitive::Placement { path, .. }
        | Primitive::Scalar { path, .. }
        | Primitive::Image { path, .. }
        | Primitive::Text { path, .. } => path,
    };
    match (owner, primitive) {
        (SceneOwner::Sensor(name) | SceneOwner::Track { sensor: name, .. }, Primitive::Image { .. }) => {
            format!("camera/{name}/{relative}")
        }
        (SceneOwner::World, _) => format!("world/{relative}"),
        (SceneOwner::Sensor(name), _) => format!("world/sensors/{name}/{relative}"),
        (SceneOwner::Track { track, sensor }, _) => format!("world/tracks/{track}/{sensor}/{relative}"),
    }
}

/// World points that the picture must hold; empty for what has no place.
pub(crate) fn extent_points_m(primitive: &Primitive) -> Vec<[f32; 3]> {
    match primitive {
        Primitive::Points { positions_world_m, .. } => positions_world_m.clone(),
        Primitive::Lines { strips_world_m, .. } => strips_world_m.iter().flatten().copied().collect(),
        Primitive::Arrows { origins_world_m, .. } => origins_world_m.clone(),
        Primitive::Mesh { vertices_world_m, .. } => vertices_world_m.clone(),
        Primitive::Placement { .. }
        | Primitive::Scalar { .. }
        | Primitive::Image { .. }
        | Primitive::Text { .. } => Vec::new(),
    }
}

/// The components of a primitive.
pub(crate) fn components(owner: &SceneOwner, primitive: &Primitive) -> Vec<SerializedComponentBatch> {
    let colours = |rgba: &[u32]| rgba.iter().copied().map(Color::from_u32).collect::<Vec<_>>();
    let screen = |points: f32| rerun::components::Radius::new_ui_points(points);
    match primitive {
        Primitive::Points { positions_world_m, rgba, radius_m, .. } => {
            let radius = if *radius_m > 0.0 { rerun::Radius::from(*radius_m) } else { screen(2.0) };
            rerun::Points3D::new(positions_world_m)
                .with_colors(colours(rgba))
                .with_radii([radius])
                .as_serialized_batches()
        }
        Primitive::Lines { strips_world_m, rgba, .. } => rerun::LineStrips3D::new(strips_world_m)
            .with_colors(colours(rgba))
            .with_radii([screen(LINE_POINTS)])
            .as_serialized_batches(),
        Primitive::Arrows { origins_world_m, vectors_m, rgba, .. } => {
            rerun::Arrows3D::from_vectors(vectors_m)
                .with_origins(origins_world_m)
                .with_colors(colours(rgba))
                .with_radii([screen(ARROW_POINTS)])
                .as_serialized_batches()
        }
        Primitive::Mesh { vertices_world_m, triangles, rgba, .. } => {
            mesh(owner, vertices_world_m, triangles, rgba).as_serialized_batches()
        }
        Primitive::Placement { world_from_path, .. } => {
            transform(world_from_path, FixKind::Full).as_serialized_batches()
        }
        Primitive::Scalar { value, .. } => rerun::Scalars::single(*value).as_serialized_batches(),
        Primitive::Image { jpeg, .. } => rerun::EncodedImage::from_file_contents(jpeg.clone())
            .with_media_type(rerun::MediaType::JPEG)
            .as_serialized_batches(),
        Primitive::Text { text, .. } => rerun::TextLog::new(text.as_str()).as_serialized_batches(),
    }
}

/// A mesh with normals; triangles that name a vertex that is not there are left out.
fn mesh(owner: &SceneOwner, vertices: &[[f32; 3]], triangles: &[[u32; 3]], rgba: &[u32]) -> rerun::Mesh3D {
    let sound: Vec<[u32; 3]> =
        triangles.iter().filter(|t| t.iter().all(|&i| (i as usize) < vertices.len())).copied().collect();
    let mut mesh = rerun::Mesh3D::new(vertices)
        .with_vertex_normals(smooth_normals(vertices, &sound))
        .with_triangle_indices(sound);
    // The viewer ignores the opacity of vertices: the least of them is taken for the whole mesh.
    let least = rgba.iter().map(|c| (c & 0xff) as u8).min().unwrap_or(0xff);
    let alpha = if least == 0xff && *owner == SceneOwner::World { WORLD_MESH_ALPHA } else { least };
    if rgba.len() == vertices.len() && rgba.len() > 1 {
        mesh = mesh.with_vertex_colors(rgba.iter().map(|c| Color::from_u32(with_alpha(*c, 0xff))));
        mesh = mesh.with_albedo_factor(rerun::Rgba32::from_u32(with_alpha(0xffff_ff00, alpha)));
    } else {
        let colour = rgba.first().copied().unwrap_or(0xb0b0_b0ff);
        mesh = mesh.with_albedo_factor(rerun::Rgba32::from_u32(with_alpha(colour, alpha)));
    }
    mesh
}

/// Unit normals per vertex, area weighted; zero area gives +z.
fn smooth_normals(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let at = |i: u32| nalgebra::Vector3::from(vertices[i as usize]).cast::<f64>();
    let mut sums = vec![nalgebra::Vector3::<f64>::zeros(); vertices.len()];
    for &[a, b, c] in triangles {
        let twice_area = (at(b) - at(a)).cross(&(at(c) - at(a)));
        for i in [a, b, c] {
            sums[i as usize] += twice_area;
        }
    }
    sums.iter()
        .map(|sum| sum.try_normalize(1e-30).map_or([0.0, 0.0, 1.0], |n| n.cast::<f32>().into()))
        .collect()
}

/// FNV-1a of a row's content.
pub(crate) fn fingerprint(batches: &[SerializedComponentBatch]) -> u64 {
    use rerun::external::arrow::array::Array as _;
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut eat = |bytes: &[u8]| {
        for byte in bytes {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    let mut waiting: Vec<rerun::external::arrow::array::ArrayData> = Vec::new();
    for batch in batches {
        eat(batch.descriptor.component.as_str().as_bytes());
        waiting.push(batch.array.to_data());
        while let Some(data) = waiting.pop() {
            eat(&data.len().to_le_bytes());
            for buffer in data.buffers() {
                eat(buffer.as_slice());
            }
            waiting.extend(data.child_data().iter().cloned());
        }
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_normals_of_a_flat_square_point_up() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        for normal in smooth_normals(&vertices, &[[0, 1, 2], [0, 2, 3]]) {
            assert_eq!(normal, [0.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn law_a_mesh_with_a_bad_index_is_drawn_without_that_triangle() {
        let mesh = mesh(
            &SceneOwner::World,
            &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            &[[0, 1, 2], [0, 1, 9]],
            &[],
        );
        assert_eq!(mesh.num_triangles(), 1);
        assert!(mesh.sanity_check().is_ok());
    }

    #[test]
    fn law_the_fingerprint_sees_every_number() {
        let points = |x: f32| {
            let primitive = Primitive::Points {
                path: "p".into(),
                positions_world_m: vec![[x, 0.0, 0.0]],
                rgba: vec![0xff],
                radius_m: 0.01,
            };
            fingerprint(&components(&SceneOwner::World, &primitive))
        };
        assert_eq!(points(1.0), points(1.0));
        assert_ne!(points(1.0), points(1.000_000_1));
    }

    #[test]
    fn law_a_placement_stands_above_what_it_carries_and_moves() {
        let placement = |z_m: f64| Primitive::Placement {
            path: "tract".into(),
            world_from_path: nalgebra::Isometry3::translation(0.0, 0.0, z_m),
        };
        let lumen = Primitive::Lines { path: "tract/lumen".into(), strips_world_m: vec![], rgba: vec![] };
        let below = path(&SceneOwner::World, &placement(0.0)) + "/";
        assert!(path(&SceneOwner::World, &lumen).starts_with(&below));
        let print = |z_m: f64| fingerprint(&components(&SceneOwner::World, &placement(z_m)));
        assert_ne!(print(0.1), print(0.2));
        assert!(!components(&SceneOwner::World, &placement(0.1)).is_empty());
    }
}
