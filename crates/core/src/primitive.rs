//! What a plugin draws. Recording and report show these without knowing the modality.
//!
//! Paths are relative to the plugin's own place (`/world/sensors/<sensor>/…` for a sensor, `/world/readings/<sensor>/…`
//! for a front end); positions are world metres, unless a [`Primitive::Placement`] carries what stands below its path.

/// One thing to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Primitive {
    /// Points.
    Points {
        /// Where in the plugin's tree.
        path: String,
        /// World positions, m.
        positions_world_m: Vec<[f32; 3]>,
        /// Colours `0xRRGGBBAA`, one per point or one for all.
        rgba: Vec<u32>,
        /// Radius, m.
        radius_m: f32,
    },
    /// Line strips.
    Lines {
        /// Where in the plugin's tree.
        path: String,
        /// World positions, m.
        strips_world_m: Vec<Vec<[f32; 3]>>,
        /// Colours, one per strip or one for all.
        rgba: Vec<u32>,
    },
    /// Arrows.
    Arrows {
        /// Where in the plugin's tree.
        path: String,
        /// Origins, world m.
        origins_world_m: Vec<[f32; 3]>,
        /// Vectors, m as drawn.
        vectors_m: Vec<[f32; 3]>,
        /// Colours, one per arrow or one for all.
        rgba: Vec<u32>,
    },
    /// A triangle mesh.
    Mesh {
        /// Where in the plugin's tree.
        path: String,
        /// Vertices, world m.
        vertices_world_m: Vec<[f32; 3]>,
        /// Corner indices.
        triangles: Vec<[u32; 3]>,
        /// Colour per vertex, or one for all.
        rgba: Vec<u32>,
    },
    /// Where everything at and below a path is from now on.
    Placement {
        /// Where in the plugin's tree.
        path: String,
        /// Pose, in the world, of the frame in which the positions there are given.
        world_from_path: nalgebra::Isometry3<f64>,
    },
    /// A number over time.
    Scalar {
        /// Where in the plugin's tree, with the unit.
        path: String,
        /// Its value.
        value: f64,
    },
    /// An encoded image (JPEG).
    Image {
        /// Where in the plugin's tree.
        path: String,
        /// JPEG bytes.
        jpeg: Vec<u8>,
    },
    /// A line of text for the log.
    Text {
        /// Where in the plugin's tree.
        path: String,
        /// The line.
        text: String,
    },
}
