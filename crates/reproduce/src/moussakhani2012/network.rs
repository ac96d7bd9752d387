//! The sensor networks and the magnet of the paper, their bound, and how a claim becomes a row.

use crate::ReproduceError;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_fields::FieldSource;
use lumenav_figures::{Axis, Figure, Panel};
use lumenav_magnetic::array::SensorArray;
use lumenav_magnetic::bound::{Bound, bound};
use lumenav_magnetic::channels::{Channels, MagnetPose};
use nalgebra::{Isometry3, Vector3};

/// Noise of a reading, T (Honeywell HMC1043).
pub(super) const SIGMA_TESLA: f64 = 1.2e-8;
/// The paper leaves the strength open; "16 sensors, about 2 mm" pins it, T m³.
pub(super) const STRENGTH_T_M3: f64 = 1.212_891e-8;
/// Half the side of the grid, m.
const HALF_M: f64 = 0.25;
/// Usual height of the magnet above the sensors, m.
pub(super) const HEIGHT_M: f64 = 0.25;

pub(super) fn source() -> FieldSource {
    FieldSource::Dipole { strength_t_m3: STRENGTH_T_M3 }
}

fn spread(i: usize, count: usize) -> f64 {
    HALF_M * (2.0 * i as f64 / (count - 1) as f64 - 1.0)
}

/// `side` x `side` sensors over 0.5 x 0.5 m, edges included.
pub(super) fn grid(side: usize, height_m: f64) -> Vec<Vector3<f64>> {
    (0..side * side).map(|i| Vector3::new(spread(i % side, side), spread(i / side, side), height_m)).collect()
}

/// Sensors on 0.5 m of the x axis, ends included.
pub(super) fn line(count: usize) -> Vec<Vector3<f64>> {
    (0..count).map(|i| Vector3::new(spread(i, count), 0.0, 0.0)).collect()
}

pub(super) fn channels(positions_m: &[Vector3<f64>]) -> Channels {
    SensorArray::of_triads("network", positions_m, SIGMA_TESLA).channels(&Isometry3::identity())
}

/// The bound of a network at a magnet.
pub(super) fn bound_at(
    positions_m: &[Vector3<f64>],
    place_m: Vector3<f64>,
    axis: Vector3<f64>,
    strength_known: bool,
) -> Result<Bound, ReproduceError> {
    let magnet = MagnetPose { position_world_m: place_m, axis_world: axis.normalize() };
    bound(&channels(positions_m), &source(), &magnet, SIGMA_TESLA, strength_known)
        .ok_or_else(|| ReproduceError::of_part("bound")("infinite for a network of the paper"))
}

/// What both variants of the strength are called.
pub(super) const VARIANTS: [(bool, &str); 2] = [(true, "strength known"), (false, "strength unknown")];

/// How a claim is put as a number.
#[derive(Clone, Copy)]
pub(super) enum Claim {
    /// Equal to this, within so much.
    Equals(f64, f64),
    /// At most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
}

/// A row for a claim; `why` says what the number does not.
pub(super) fn claim(quantity: impl Into<String>, unit: &str, claimed: Claim, ours: f64, why: &str) -> Row {
    let (published, sense, tolerance) = match claimed {
        Claim::Equals(value, within) => (value, Sense::Match, within),
        Claim::AtMost(value) => (value, Sense::LowerIsBetter, 0.0),
        Claim::AtLeast(value) => (value, Sense::HigherIsBetter, 0.0),
    };
    let row = Row::new(quantity, unit, Some(published)).ours("model", ours);
    row.claimed("model", sense, Tolerance::Absolute(tolerance), why)
}

/// What every table of this publication says of its set-up.
pub(super) fn set_up(table: &mut Table) {
    table.set("magnet", format!("{STRENGTH_T_M3:.6e} T m^3, a dipole: at this strength 16 sensors reach the 2 mm of the paper, which leaves it open"));
    table.set("noise", format!("{SIGMA_TESLA} T per axis and reading, three axes"));
    table.set("network", "0.5 x 0.5 m, sensors on its edge included");
    table.note(
        "`published` is the claim put as a number: a value, or what it is to stay below or above; a claim that does not hold does not hold for the \
         model as stated, and the figure shows it. a, b and c are the magnet's coordinates: a and b in the plane of the sensors, c its height above it",
    );
}

/// The figure of a reproduction.
pub(super) fn figure(panels: Vec<Panel>) -> Result<NamedFigure, ReproduceError> {
    Ok(NamedFigure { name: String::new(), svg: Figure::grid(panels, 2).to_svg()? })
}

/// The axis upwards of all figures.
pub(super) fn bound_axis() -> Axis {
    Axis::logarithmic("bound (mm)")
}
