//! Section 4: the magnet against radio. As many receivers of signal strength at the same places as there are magnetometers, the same capsule.
//!
//! Received strength in dB at distance d (bao2014, equations 2.1 and 2.21 to 2.26), with log-normal shadowing of standard deviation σ, independent
//! from receiver to receiver:
//!
//! ```text
//! z = P - 10 α log₁₀(d/d₀) + n          ∂z/∂p = -(10 α/ln 10) (p - s)/d²          I = Σ ∂z/∂p ∂z/∂pᵀ/σ²
//! ```
//!
//! and one more column of ones where the transmitted power P is unknown. α and σ: the implant-to-surface model that bao2014 quotes (NIST,
//! MICS band). Independent shadowing is kind to the radio: neighbours in truth share it.

use super::network::{Claim, bound_at, bound_axis, claim, figure, grid, set_up};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use lumenav_figures::{Axis, Panel, Series};
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

/// A channel from an implant to the body's surface.
struct Tissue {
    name: &'static str,
    exponent: f64,
    shadowing_db: f64,
}

const TISSUES: [Tissue; 2] = [
    Tissue { name: "deep tissue", exponent: 4.26, shadowing_db: 7.85 },
    Tissue { name: "near surface", exponent: 4.22, shadowing_db: 6.81 },
];

/// What is published of the radio's accuracy, mm: not better than three centimetres.
const RADIO_AT_BEST_MM: f64 = 30.0;
/// Heights of the figure, m.
const HEIGHTS_M: [f64; 12] = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0];
const USUAL_M: f64 = 0.25;

/// Square root of the trace of the position's bound from received strengths, m.
fn rss_bound_m(
    receivers_m: &[Vector3<f64>],
    place_m: &Vector3<f64>,
    tissue: &Tissue,
    power_known: bool,
) -> Result<f64, ReproduceError> {
    let slope_db = 10.0 * tissue.exponent / std::f64::consts::LN_10;
    let mut information = Matrix4::zeros();
    for receiver in receivers_m {
        let away = place_m - receiver;
        let by_place = away * (-slope_db / away.norm_squared());
        // Power in units of a decibel beside metres: both of one size here.
        let row = Vector4::new(by_place.x, by_place.y, by_place.z, f64::from(u8::from(!power_known)));
        information += row * row.transpose() / tissue.shadowing_db.powi(2);
    }
    let of_place: Matrix3<f64> = information.fixed_view::<3, 3>(0, 0).into_owned();
    let trace = if power_known {
        of_place.cholesky().map(|factor| factor.inverse().trace())
    } else {
        information.cholesky().map(|factor| factor.inverse().fixed_view::<3, 3>(0, 0).trace())
    };
    trace.map(f64::sqrt).ok_or_else(|| ReproduceError::of_part("bound of received strengths")("infinite"))
}

/// The worse of a magnet along z and one along x, m.
fn magnet_bound_m(side: usize, height_m: f64) -> Result<f64, ReproduceError> {
    let place = Vector3::new(0.0, 0.0, height_m);
    let mut worst: f64 = 0.0;
    for axis in [Vector3::z(), Vector3::x()] {
        worst = worst.max(bound_at(&grid(side, 0.0), place, axis, false)?.position_m2.trace().sqrt());
    }
    Ok(worst)
}

fn radio_bound_m(side: usize, height_m: f64, tissue: &Tissue, known: bool) -> Result<f64, ReproduceError> {
    rss_bound_m(&grid(side, 0.0), &Vector3::new(0.0, 0.0, height_m), tissue, known)
}

/// The height at which the radio becomes the better of the two, m, by bisection.
fn crossing_m(side: usize, tissue: &Tissue) -> Result<Option<f64>, ReproduceError> {
    let lead = |h: f64| -> Result<f64, ReproduceError> {
        Ok(radio_bound_m(side, h, tissue, true)? / magnet_bound_m(side, h)?)
    };
    let (mut near, mut far) = (0.1, 3.0);
    if lead(near)? < 1.0 || lead(far)? > 1.0 {
        return Ok(None);
    }
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if lead(middle)? > 1.0 { near = middle } else { far = middle }
    }
    Ok(Some(near))
}

/// Runs it.
pub(crate) fn run(_context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    set_up(&mut table);
    table.set("radio", "received strength at the magnetometers' places, independent shadowing; exponents and shadowing as bao2014 quotes NIST");
    table.set("magnet's strength", "unknown; the worse of its axis along z and along x");
    for side in [4, 10] {
        let n = side * side;
        for tissue in &TISSUES {
            for (known, power) in [(true, "power known"), (false, "power unknown")] {
                let ours = 1e3 * radio_bound_m(side, USUAL_M, tissue, known)?;
                let quantity =
                    format!("bound from received strength at 0.25 m, N = {n}, {}, {power}", tissue.name);
                let why = "at least three centimetres is claimed of radio, citing others";
                table.rows.push(claim(quantity, "mm", Claim::AtLeast(RADIO_AT_BEST_MM), ours, why));
            }
            let mut least = f64::INFINITY;
            for height_m in HEIGHTS_M.into_iter().filter(|h| *h <= 0.5) {
                least =
                    least.min(radio_bound_m(side, height_m, tissue, true)? / magnet_bound_m(side, height_m)?);
            }
            table.rows.push(claim(
                format!(
                    "radio's bound over the magnet's up to 0.5 m, least, N = {n}, {}, power known",
                    tissue.name
                ),
                "",
                Claim::AtLeast(1.0),
                least,
                "the magnet is the better of the two at equal number and distance",
            ));
            let row = Row::new(
                format!("height at which radio becomes the better, N = {n}, {}", tissue.name),
                "m",
                None,
            );
            let row = match crossing_m(side, tissue)? {
                Some(height_m) => row.ours("model", height_m),
                None => row,
            };
            table.rows.push(row.not_comparable("the source gives none: the magnet's bound grows with the fourth power of the height and more, radio's with the second; the law of an implant in a body is carried on beyond one here"));
        }
    }
    table.figures.push(figure(vec![panel(4)?, panel(10)?])?);
    Ok(table)
}

fn panel(side: usize) -> Result<Panel, ReproduceError> {
    let mut panel = Panel::new(Axis::logarithmic("height c (m)"), bound_axis())
        .titled(&format!("{} sensors", side * side));
    let curve = |of: &dyn Fn(f64) -> Result<f64, ReproduceError>| -> Result<Vec<(f64, f64)>, ReproduceError> {
        HEIGHTS_M.iter().map(|h| Ok((*h, 1e3 * of(*h)?))).collect()
    };
    panel = panel.with(Series::ours(0, "magnet, norm").points(&curve(&|h| magnet_bound_m(side, h))?));
    for (k, tissue) in TISSUES.iter().enumerate() {
        let points = curve(&|h| radio_bound_m(side, h, tissue, true))?;
        panel = panel.with(Series::ours(k + 1, &format!("radio, {}", tissue.name)).points(&points));
    }
    Ok(panel)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six receivers at distance r along both directions of each axis: `I = 2 (10 α/(σ ln 10))²/r² · 1` and nothing is lost to the power.
    #[test]
    fn closed_form_the_bound_in_the_middle_of_an_octahedron() {
        let (r, tissue) = (0.2, &TISSUES[0]);
        let receivers: Vec<Vector3<f64>> =
            (0..3).flat_map(|i| [1.0, -1.0].map(|sign| Vector3::ith(i, sign * r))).collect();
        let wanted = 3.0_f64.sqrt() * r * 7.85 * std::f64::consts::LN_10 / (42.6 * 2.0_f64.sqrt());
        for known in [true, false] {
            let found = rss_bound_m(&receivers, &Vector3::zeros(), tissue, known).unwrap();
            assert!((found / wanted - 1.0).abs() < 1e-12, "{found} {wanted}");
        }
    }

    #[test]
    fn law_an_unknown_power_costs_and_more_receivers_gain() {
        let place = Vector3::new(0.03, -0.05, 0.25);
        for tissue in &TISSUES {
            let of = |side: usize, known: bool| rss_bound_m(&grid(side, 0.0), &place, tissue, known).unwrap();
            assert!(of(4, true) < of(4, false) && of(10, false) < of(4, false));
            // Twice the receivers, at the same places: the square root of two.
            let twice = [grid(4, 0.0), grid(4, 0.0)].concat();
            let doubled = rss_bound_m(&twice, &place, tissue, true).unwrap();
            assert!((of(4, true) / doubled - 2.0_f64.sqrt()).abs() < 1e-9);
        }
    }
}
