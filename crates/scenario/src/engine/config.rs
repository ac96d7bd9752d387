//! `[engine]`: its keys, their defaults and what they may be. Sources of the defaults: [`super::ENGINE_SOURCES`].

use super::EngineError;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::CapsuleBody;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use serde::{Deserialize, Serialize};

/// Allowed step rates, 1/s.
const STEP_RATES_HZ: std::ops::RangeInclusive<u32> = 60..=10_000;

/// `[engine]`: numbers of the engine. (S) stated by a source, (B) believed, (T) tuned here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EngineConfig {
    /// Steps per second, 60 to 10,000. Default 240: end points agree with those at 1,000 Hz within 1 %.
    pub step_rate_hz: u32,
    /// Where the capsule's centre starts, arc length, m. Default: 20 mm behind the tract's oral end. A scenario says it as
    /// `capsule.start_arc_length_mm`.
    #[serde(skip)]
    pub start_arc_length_m: NonNegative,
    /// Turn of the capsule about its axis at the start, rad. Default 0. A scenario says it as `capsule.start_roll_deg`.
    #[serde(skip)]
    pub start_roll_rad: Finite,
    /// Longest time that the capsule is given before t = 0 to come to rest on the wall, s; the wall stands still meanwhile. 0: it starts
    /// on the centre line and falls. Default 10 (B): most starts in a colon take 1 to 3 s.
    pub settle_s: NonNegative,
    /// Whether a capsule that rests where the wall stands still is left there unstepped until a wave comes. Default true.
    pub sleep: bool,
    /// Gravity in the torso frame, m/s². Default (0, -9.81, 0): lying on the back.
    pub gravity_torso_m_s2: [Finite; 3],
    /// Segments without fluid: no buoyancy and no drag. Default the oesophagus, through which a sip of water runs ahead; bowels are
    /// prepared with litres of fluid.
    pub dry_segments: Vec<SegmentKey>,
    /// Density of the fluid, kg/m³. Default 1000 (S).
    pub fluid_density_kg_m3: NonNegative,
    /// Viscosity of the fluid, Pa s. Default 0.001, water.
    pub fluid_viscosity_pa_s: NonNegative,
    /// Drag coefficient of a short cylinder across. Default 1 (0.6 to 1.2 over the Reynolds numbers met, Hoerner 1965).
    pub drag_coefficient: NonNegative,
    /// Adhesion of the wall, N: Coulomb-like, for the capsule as a whole. Default 0.025 (B).
    pub coulomb_newton: NonNegative,
    /// Slip speed at which friction is fully developed, m/s. Default 2e-6 [T to "no transport without waves": with the 2e-4 first
    /// proposed, a capsule creeps 7 mm a minute down a slope].
    pub regularisation_m_s: Positive,
    /// Viscous friction of a wall all around the capsule, N s/m. Default 15 [B: 91 mN of traction at 1 to 5 mm/s].
    pub viscous_newton_s_per_m: NonNegative,
    /// How much stiffer a fully contracted wall is than a resting one: k (1 + this x closed fraction). Default 14 [T to "a mass
    /// movement of the colon takes the capsule along"; muscle in tone is stiff, and its pressure of 14 kPa (S) on the capsule's
    /// cross-section would be 1.3 N].
    pub contraction_stiffening: NonNegative,
    /// Stiffness of a closed end, N/m. Default 200 (B): the capsule's weight makes 0.05 mm.
    pub cap_stiffness_newton_per_m: Positive,
    /// Damping of a closed end, N s/m. Default 8, that of a ring (B).
    pub cap_damping_newton_s_per_m: NonNegative,
    /// A capsule that has not moved by `stalled_distance_m` for so long is `stalled`, s. Default 600 (B).
    pub stalled_after_s: Positive,
    /// And for so long, `retained`, s. Default 21600 (6 h) [B: above the longest rest between two mass movements expected].
    pub retained_after_s: Positive,
    /// See `stalled_after_s`, m. Default 0.01.
    pub stalled_distance_m: Positive,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            step_rate_hz: 240,
            start_arc_length_m: NonNegative(0.02),
            start_roll_rad: Finite(0.0),
            settle_s: NonNegative(10.0),
            sleep: true,
            gravity_torso_m_s2: [Finite(0.0), Finite(-9.81), Finite(0.0)],
            dry_segments: vec![SegmentKey::Oesophagus],
            fluid_density_kg_m3: NonNegative(1000.0),
            fluid_viscosity_pa_s: NonNegative(1e-3),
            drag_coefficient: NonNegative(1.0),
            coulomb_newton: NonNegative(0.025),
            regularisation_m_s: Positive(2e-6),
            viscous_newton_s_per_m: NonNegative(15.0),
            contraction_stiffening: NonNegative(14.0),
            cap_stiffness_newton_per_m: Positive(200.0),
            cap_damping_newton_s_per_m: NonNegative(8.0),
            stalled_after_s: Positive(600.0),
            retained_after_s: Positive(21_600.0),
            stalled_distance_m: Positive(0.01),
        }
    }
}

/// Refuses what lies outside its range.
pub(super) fn check(config: &EngineConfig, tract: &Tract, capsule: &CapsuleBody) -> Result<(), EngineError> {
    let in_range = |name, value: f64, low: f64, high: f64| {
        if (low..=high).contains(&value) {
            Ok(())
        } else {
            Err(EngineError::OutOfRange { name, value, low, high })
        }
    };
    let (low, high) = (*STEP_RATES_HZ.start(), *STEP_RATES_HZ.end());
    in_range("step_rate_hz", f64::from(config.step_rate_hz), f64::from(low), f64::from(high))?;
    in_range("start_arc_length_m", config.start_arc_length_m.0, 0.0, tract.length_m())?;
    in_range("start_roll_rad", config.start_roll_rad.0, -1e3, 1e3)?;
    in_range("settle_s", config.settle_s.0, 0.0, 1e4)?;
    for g in config.gravity_torso_m_s2 {
        in_range("gravity_torso_m_s2", g.0, -100.0, 100.0)?;
    }
    // Wide of anything in a gut, and narrow enough that no step can overflow.
    for (name, value, low, high) in [
        ("fluid_density_kg_m3", config.fluid_density_kg_m3.0, 0.0, 2e4),
        ("fluid_viscosity_pa_s", config.fluid_viscosity_pa_s.0, 0.0, 1e3),
        ("drag_coefficient", config.drag_coefficient.0, 0.0, 1e3),
        ("coulomb_newton", config.coulomb_newton.0, 0.0, 100.0),
        ("regularisation_m_s", config.regularisation_m_s.0, 1e-9, 1.0),
        ("viscous_newton_s_per_m", config.viscous_newton_s_per_m.0, 0.0, 1e5),
        ("contraction_stiffening", config.contraction_stiffening.0, 0.0, 1e3),
        ("cap_stiffness_newton_per_m", config.cap_stiffness_newton_per_m.0, 0.1, 1e6),
        ("cap_damping_newton_s_per_m", config.cap_damping_newton_s_per_m.0, 0.0, 1e5),
        ("stalled_after_s", config.stalled_after_s.0, 1e-3, 1e9),
        ("retained_after_s", config.retained_after_s.0, 1e-3, 1e9),
        ("stalled_distance_m", config.stalled_distance_m.0, 1e-6, 10.0),
    ] {
        in_range(name, value, low, high)?;
    }
    let CapsuleBody { radius_m, length_m, mass_kg } = *capsule;
    let sound =
        radius_m > 0.0 && mass_kg > 0.0 && length_m > 2.0 * radius_m && (length_m * mass_kg).is_finite();
    if sound { Ok(()) } else { Err(EngineError::CapsuleShape { radius_m, length_m, mass_kg }) }
}
