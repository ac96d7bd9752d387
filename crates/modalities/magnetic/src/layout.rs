//! The array as a layout: what each magnetometer would say about the magnet's position and axis in one reading.
//!
//! A channel with axis a at s reads `z = a · B(u, s - p)`. With the magnet at `o` in the capsule, `p = p_c + R o`, and tangent
//! directions `e_i` of the axis u, the row of channel k and its variance are
//!
//! ```text
//! g = [ ∂z/∂p ;  ∂z/∂u · e_i + ∂z/∂p · ((u × e_i) × R o) ;  z (relative strength) ;  a (ambient field) ]
//! v = σ² + σ_bias² + (σ_gain z)²                    I = Σ_k g gᵀ / v
//! ```
//!
//! An offset and a gain error of each channel, drawn once from their laws and never estimated, count in one reading as noise of their
//! own: that is what is left of them when they are integrated out. The roll about the axis is unobservable and taken as known,
//! which matters for a magnet beside the capsule's axis alone. A channel beyond the converter's limit says nothing.

use crate::array::{Axes, SensorArray};
use crate::config::{Installed, Law};
use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::layout::packed_len;
use lumenav_core::pose::tangent_basis;
use lumenav_core::{LayoutElement, LayoutModel, LayoutParameters, LayoutWorker, ModalityError, Node, Setup};
use lumenav_fields::{FieldSource, FluxJacobian};
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// `[layout.model]` of a magnetic sensor.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayoutTable {
    /// Field law.
    pub law: Law,
    /// Whether the magnet's strength is unknown.
    pub unknown_strength: bool,
    /// Standard deviation of its relative error beforehand; absent: nothing is known.
    pub strength_sigma: Option<Positive>,
    /// Whether a uniform ambient field is unknown.
    pub unknown_ambient: bool,
    /// Its standard deviation beforehand per axis, T; absent: nothing is known.
    pub ambient_sigma_tesla: Option<Positive>,
    /// Standard deviation of a constant offset per channel that nobody has calibrated, T.
    pub bias_sigma_tesla: NonNegative,
    /// Standard deviation of a relative gain error per channel that nobody has calibrated.
    pub gain_sigma: NonNegative,
    /// A sensor array whose sensors are the candidates of `layout optimize`.
    pub candidates: Option<String>,
}

/// Where the defaults come from.
pub const LAYOUT_SOURCES: [(&str, &str); 8] = [
    ("law", "exact field of the cylinder, Derby and Olbert 2010"),
    ("unknown_strength", "chosen: the magnet is as its model says"),
    ("strength_sigma", "chosen: nothing is known beforehand"),
    ("unknown_ambient", "chosen: the Earth's field is taken off before"),
    ("ambient_sigma_tesla", "chosen: nothing is known beforehand"),
    ("bias_sigma_tesla", "chosen: a calibrated array"),
    ("gain_sigma", "chosen: a calibrated array"),
    ("candidates", "chosen: none"),
];

/// An array as a layout.
#[derive(Clone, Debug)]
pub struct ArrayLayout {
    array: SensorArray,
    elements: Vec<LayoutElement>,
    candidates: Vec<LayoutElement>,
    parameters: LayoutParameters,
    table: LayoutTable,
    source: FieldSource,
    offset_capsule_m: Vector3<f64>,
    /// Nearer than this a sensor stands in the magnet, m.
    nearest_m: f64,
    noise_tesla: f64,
    limit_tesla: Option<f64>,
    strength_t_m3: f64,
}

/// The kinds of element.
const KINDS: [Axes; 4] = [Axes::Xyz, Axes::X, Axes::Y, Axes::Z];

fn kind_of(axes: Axes) -> usize {
    KINDS.iter().position(|kind| *kind == axes).unwrap_or_default()
}

/// Reference sensors are no part of a layout: they tell the ambient field, from where they stand.
fn elements_of(array: &SensorArray) -> Vec<LayoutElement> {
    let element = |(i, sensor): (usize, &crate::array::Magnetometer)| LayoutElement {
        name: format!("s{i}"),
        world_from_element: sensor.pose,
        kind: kind_of(sensor.axes),
        cost: sensor.axes.indices().len() as f64,
    };
    array.sensors.iter().enumerate().filter(|(_, sensor)| !sensor.reference).map(element).collect()
}

impl ArrayLayout {
    /// Reads the installed array, the magnet and `[layout.model]`.
    ///
    /// # Errors
    /// [`ModalityError::Config`] with file, line and key.
    pub fn from_nodes(installed: &Node, options: &Node, setup: &Setup) -> Result<Self, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table: LayoutTable = options.parse_sourced(&LAYOUT_SOURCES)?;
        for (key, sigma, needs, is_unknown) in [
            ("strength_sigma", table.strength_sigma, "unknown_strength", table.unknown_strength),
            ("ambient_sigma_tesla", table.ambient_sigma_tesla, "unknown_ambient", table.unknown_ambient),
        ] {
            if sigma.is_some() && !is_unknown {
                let message =
                    format!("says how well something is known that is known; set `{needs} = true` too");
                return Err(options.error_at(key, &message).into());
            }
        }
        let candidates = match &table.candidates {
            None => Vec::new(),
            Some(name) => {
                let file = setup.models.open("sensor-arrays", name, options, "candidates")?;
                let candidates = SensorArray::from_node(&file)?;
                let built = Installed { array: candidates.clone(), ..opened.clone() };
                let of = |installed: &Installed| (installed.reading_sigma_tesla(), installed.limit_tesla());
                if of(&built) != of(&opened) {
                    let message = format!(
                        "the candidates are other sensors than the installed ones, by which all are judged: noise, saturation and resolution of `{}` and `{}` differ",
                        candidates.name, opened.array.name
                    );
                    return Err(options.error_at("candidates", &message).into());
                }
                elements_of(&candidates)
            }
        };
        let mut nuisance = Vec::new();
        if table.unknown_strength {
            nuisance.push("relative strength");
        }
        if table.unknown_ambient {
            nuisance.extend(["ambient x (T)", "ambient y (T)", "ambient z (T)"]);
        }
        let cylinder = opened.magnet.cylinder;
        Ok(Self {
            elements: elements_of(&opened.array),
            candidates,
            parameters: LayoutParameters { angles: 2, nuisance },
            source: opened.magnet.source(table.law),
            offset_capsule_m: opened.magnet.offset_capsule_m,
            nearest_m: cylinder.radius_m().hypot(cylinder.half_length_m()),
            noise_tesla: opened.reading_sigma_tesla(),
            limit_tesla: opened.limit_tesla(),
            strength_t_m3: cylinder.strength_t_m3(),
            array: opened.array,
            table,
        })
    }

    /// The magnet's place and axis for a capsule's pose.
    fn magnet(&self, world_from_capsule: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let arm = world_from_capsule.rotation * self.offset_capsule_m;
        (world_from_capsule.translation.vector + arm, world_from_capsule.rotation * Vector3::x(), arm)
    }
}

impl LayoutModel for ArrayLayout {
    fn elements(&self) -> &[LayoutElement] {
        &self.elements
    }

    fn candidates(&self) -> &[LayoutElement] {
        &self.candidates
    }

    fn cost_unit(&self) -> &'static str {
        "channels"
    }

    fn parameters(&self) -> &LayoutParameters {
        &self.parameters
    }

    fn prior(&self) -> Vec<f64> {
        let dimension = self.parameters.len();
        let mut prior = vec![0.0; packed_len(dimension)];
        let mut know = |parameter: usize, sigma: f64| {
            prior[packed_len(parameter) + parameter] = sigma.powi(-2);
        };
        if let Some(sigma) = self.table.strength_sigma {
            know(5, sigma.0);
        }
        if let Some(sigma) = self.table.ambient_sigma_tesla {
            (dimension - 3..dimension).for_each(|parameter| know(parameter, sigma.0));
        }
        prior
    }

    fn worker(&self) -> Box<dyn LayoutWorker + '_> {
        Box::new(Worker { layout: self, offsets_m: Vec::new(), fields: Vec::new() })
    }

    fn blocked(&self, element: &LayoutElement, world_from_capsule: &Isometry3<f64>) -> Option<String> {
        let (place, axis, _) = self.magnet(world_from_capsule);
        let offset = element.world_from_element.translation.vector - place;
        if offset.norm() < self.nearest_m {
            return Some("stands in the magnet".to_owned());
        }
        let field = self.source.flux_tesla(&axis, &offset);
        let limit = self.limit_tesla?;
        let rotation = &element.world_from_element.rotation;
        let largest = KINDS[element.kind]
            .indices()
            .iter()
            .map(|axis| (rotation * Vector3::ith(*axis, 1.0)).dot(&field).abs())
            .fold(0.0, f64::max);
        (largest > limit).then(|| format!("saturated: {largest:.2e} T of {limit:.2e}"))
    }

    fn least_distance_m(&self) -> f64 {
        // On its axis a dipole has twice its strength over the cube of the distance.
        let saturated = self.limit_tesla.map_or(0.0, |limit| (2.0 * self.strength_t_m3 / limit).cbrt());
        saturated.max(self.nearest_m) + self.offset_capsule_m.norm()
    }

    fn is_memoryless(&self) -> bool {
        self.parameters.nuisance.is_empty()
            && self.table.bias_sigma_tesla.0 == 0.0
            && self.table.gain_sigma.0 == 0.0
    }

    fn assumptions(&self) -> Vec<String> {
        let mut said = vec![format!("noise {:.3} nT", 1e9 * self.noise_tesla)];
        if self.table.bias_sigma_tesla.0 > 0.0 {
            said.push(format!("an offset of {:.3} nT per channel", 1e9 * self.table.bias_sigma_tesla.0));
        }
        if self.table.gain_sigma.0 > 0.0 {
            said.push(format!("a gain error of {:.3} % per channel", 100.0 * self.table.gain_sigma.0));
        }
        said
    }

    fn to_toml(&self, name: &str, source: &str, elements: &[LayoutElement]) -> Option<String> {
        let mut text = String::new();
        let quoted = |words: &str| toml_string(words);
        // Writing to a string cannot fail.
        let source = format!("places: {source}; noise and limits: array `{}`", self.array.name);
        let _ = writeln!(text, "# Found by a search for a layout.");
        let _ = writeln!(text, "[array]\nname = {}\nsource = {}", quoted(name), quoted(&source));
        let _ = writeln!(text, "noise_tesla = {:e}", self.array.noise_tesla);
        let starts: Vec<String> = self.array.starts_m().iter().map(millimetres).collect();
        if !starts.is_empty() {
            let _ = writeln!(text, "start_positions_mm = [{}]", starts.join(", "));
        }
        if let Some(limit) = self.array.saturation_tesla {
            let _ = writeln!(text, "saturation_tesla = {limit:e}");
        }
        if let Some(step) = self.array.resolution_tesla {
            let _ = writeln!(text, "resolution_tesla = {step:e}");
        }
        for element in elements {
            write_sensor(&mut text, &element.world_from_element, element.kind);
        }
        for sensor in self.array.sensors.iter().filter(|sensor| sensor.reference) {
            write_sensor(&mut text, &sensor.pose, kind_of(sensor.axes));
            let _ = writeln!(text, "reference = true");
        }
        Some(text)
    }
}

fn millimetres(place_m: &Vector3<f64>) -> String {
    let place = place_m * 1e3;
    format!("[{:.4}, {:.4}, {:.4}]", place.x, place.y, place.z)
}

/// Adds a `[[sensor]]`. Writing to a string cannot fail.
fn write_sensor(text: &mut String, pose: &Isometry3<f64>, kind: usize) {
    let _ = writeln!(text, "\n[[sensor]]\nposition_mm = {}", millimetres(&pose.translation.vector));
    let turn = pose.rotation.scaled_axis().map(f64::to_degrees);
    if turn.norm() > 0.0 {
        let _ = writeln!(text, "rotation_vector_deg = [{:.6}, {:.6}, {:.6}]", turn.x, turn.y, turn.z);
    }
    if KINDS[kind] != Axes::Xyz {
        let _ = writeln!(text, "axes = \"{}\"", ["xyz", "x", "y", "z"][kind]);
    }
}

/// A string as TOML writes it.
fn toml_string(words: &str) -> String {
    format!("\"{}\"", words.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " "))
}

struct Worker<'a> {
    layout: &'a ArrayLayout,
    offsets_m: Vec<Vector3<f64>>,
    fields: Vec<FluxJacobian>,
}

/// Largest number of parameters: position, axis, strength, ambient field.
const MOST: usize = 9;

impl Worker<'_> {
    /// Fields at the elements; the magnet's axis and arm.
    fn predict(&mut self, elements: &[LayoutElement], pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (place, axis, arm) = self.layout.magnet(pose);
        self.offsets_m.clear();
        self.offsets_m.extend(elements.iter().map(|e| e.world_from_element.translation.vector - place));
        self.fields.resize(elements.len(), FluxJacobian::default());
        // The buffers have equal length by the line above, which is all that can fail here.
        if self.layout.source.flux_and_jacobian_batch(&axis, &self.offsets_m, &mut self.fields).is_err() {
            unreachable!("equal lengths by construction");
        }
        (axis, arm)
    }

    /// Adds what one element says.
    fn add(&self, at: usize, element: &LayoutElement, about: &About, information: &mut [f64]) {
        let layout = self.layout;
        if self.offsets_m[at].norm_squared() < layout.nearest_m.powi(2) {
            return;
        }
        let field = &self.fields[at];
        let table = &layout.table;
        let rotation = element.world_from_element.rotation.to_rotation_matrix().into_inner();
        for axis in KINDS[element.kind].indices() {
            let a: Vector3<f64> = rotation.column(*axis).into_owned();
            let flux = a.dot(&field.flux_tesla);
            if layout.limit_tesla.is_some_and(|limit| flux.abs() > limit) {
                continue;
            }
            let by_position = -field.d_flux_d_offset.tr_mul(&a);
            let by_axis = field.d_flux_d_axis.tr_mul(&a);
            let mut row = [0.0; MOST];
            row[..3].copy_from_slice(by_position.as_slice());
            for i in 0..2 {
                row[3 + i] = by_axis.dot(&about.tangents[i]) + by_position.dot(&about.moves[i]);
            }
            let mut count = 5;
            if table.unknown_strength {
                row[count] = flux;
                count += 1;
            }
            if table.unknown_ambient {
                row[count..count + 3].copy_from_slice(a.as_slice());
                count += 3;
            }
            let variance = layout.noise_tesla.powi(2)
                + table.bias_sigma_tesla.0.powi(2)
                + (table.gain_sigma.0 * flux).powi(2);
            add_outer(&row[..count], 1.0 / variance, information);
        }
    }
}

/// Tangent directions of the axis, and how the magnet moves with them.
struct About {
    tangents: [Vector3<f64>; 2],
    moves: [Vector3<f64>; 2],
}

impl About {
    fn new(axis: &Vector3<f64>, arm: &Vector3<f64>) -> Self {
        let (e1, e2) = tangent_basis(axis);
        let moved = |e: &Vector3<f64>| axis.cross(e).cross(arm);
        Self { moves: [moved(&e1), moved(&e2)], tangents: [e1, e2] }
    }
}

/// Adds `weight · row rowᵀ` to a packed lower triangle.
#[inline]
fn add_outer(row: &[f64], weight: f64, information: &mut [f64]) {
    let mut at = 0;
    for (i, left) in row.iter().enumerate() {
        let scaled = left * weight;
        for (out, right) in information[at..=at + i].iter_mut().zip(row) {
            *out += scaled * right;
        }
        at += i + 1;
    }
}

impl LayoutWorker for Worker<'_> {
    fn together(&mut self, elements: &[LayoutElement], pose: &Isometry3<f64>, information: &mut [f64]) {
        let (axis, arm) = self.predict(elements, pose);
        let about = About::new(&axis, &arm);
        information.fill(0.0);
        for (at, element) in elements.iter().enumerate() {
            self.add(at, element, &about, information);
        }
    }

    fn each(&mut self, elements: &[LayoutElement], pose: &Isometry3<f64>, informations: &mut [f64]) -> bool {
        let (axis, arm) = self.predict(elements, pose);
        let about = About::new(&axis, &arm);
        informations.fill(0.0);
        let one = packed_len(self.layout.parameters.len());
        for (at, (element, information)) in elements.iter().zip(informations.chunks_mut(one)).enumerate() {
            self.add(at, element, &about, information);
        }
        true
    }
}
