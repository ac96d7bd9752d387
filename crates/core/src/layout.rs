//! The seam of layout design: what the elements of a sensor (magnetometers, blocks of a scanner) would say about a capsule, before
//! anything is built.
//!
//! One reading's Fisher information about a vector of parameters: the position first, then the axis or attitude, then what is unknown
//! beside the pose (strength, ambient field):
//!
//! ```text
//! [δp_world (3, m), angles (2 about a tangent basis of the axis, or 3 of δθ_capsule; rad), nuisance …]
//! ```
//!
//! An information matrix is handed over as its lower triangle, row by row: `I00, I10, I11, I20, …`, [`packed_len`] numbers.

use nalgebra::Isometry3;

/// Numbers of the lower triangle of a symmetric matrix.
pub const fn packed_len(dimension: usize) -> usize {
    dimension * (dimension + 1) / 2
}

/// One part of a sensor that can be left out or put elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutElement {
    /// What it is called, for example `s3`.
    pub name: String,
    /// Where it stands.
    pub world_from_element: Isometry3<f64>,
    /// Which of the sensor's own kinds of element it is (a triad, a single axis), as the model counts them.
    pub kind: usize,
    /// What it costs, in units of the modality's [`LayoutModel::cost_unit`].
    pub cost: f64,
}

/// What the information is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayoutParameters {
    /// Angles behind the three of the position: 2 (an axis) or 3 (an attitude).
    pub angles: usize,
    /// Names of what else is unknown.
    pub nuisance: Vec<&'static str>,
}

impl LayoutParameters {
    /// Number of all of them.
    pub fn len(&self) -> usize {
        3 + self.angles + self.nuisance.len()
    }

    /// Never: a position is always asked for.
    pub fn is_empty(&self) -> bool {
        false
    }
}

/// A sensor as a layout: its elements, and what they would say.
pub trait LayoutModel: Send + Sync {
    /// The elements as installed.
    fn elements(&self) -> &[LayoutElement];

    /// Elements to choose from instead of those installed; empty where the scenario gives none.
    fn candidates(&self) -> &[LayoutElement];

    /// What the cost counts, for example `channels`.
    fn cost_unit(&self) -> &'static str;

    /// What the information is about.
    fn parameters(&self) -> &LayoutParameters;

    /// What is known beforehand of the parameters, as information; zeros where nothing is.
    fn prior(&self) -> Vec<f64>;

    /// Somebody who computes, with buffers of its own: one per thread.
    fn worker(&self) -> Box<dyn LayoutWorker + '_>;

    /// A capsule pose at which no reading is to be had from an element at this place (saturated, inside it): why.
    fn blocked(&self, element: &LayoutElement, world_from_capsule: &Isometry3<f64>) -> Option<String>;

    /// No element nearer than this to the capsule's centre is sure to give a reading, m; 0 where there is no such distance.
    fn least_distance_m(&self) -> f64 {
        0.0
    }

    /// Whether the errors of two readings are independent: of an unknown that stays, or an error that nobody has calibrated, they are not.
    fn is_memoryless(&self) -> bool {
        self.parameters().nuisance.is_empty()
    }

    /// What the judgement takes for granted beside the parameters, in words: noise, a share of background.
    fn assumptions(&self) -> Vec<String> {
        Vec::new()
    }

    /// The sensor's own file with elements at these places, which a scenario takes as it is; `None` where the modality has no such file.
    fn to_toml(&self, name: &str, source: &str, elements: &[LayoutElement]) -> Option<String>;
}

impl std::fmt::Debug for dyn LayoutModel + '_ {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "layout of {} elements", self.elements().len())
    }
}

/// Computes informations of one reading.
pub trait LayoutWorker {
    /// Of these elements together, without any prior: one packed matrix.
    fn together(
        &mut self,
        elements: &[LayoutElement],
        world_from_capsule: &Isometry3<f64>,
        information: &mut [f64],
    );

    /// Of each element by itself, one packed matrix after another. `false`, and nothing written, where elements work only together
    /// (coincidences of two blocks).
    fn each(
        &mut self,
        elements: &[LayoutElement],
        world_from_capsule: &Isometry3<f64>,
        informations: &mut [f64],
    ) -> bool;
}
