//! The wall: what the moving lumen does to the capsule, at five rings along it.
//!
//! Ring `i` is the circle of radius `ρ_i` that the capsule's profile has at `x = ξ_i` (the ends of the cylinder, the middle, and
//! the domes at 45 degrees). Its centre `c_i` projects onto the centre line at `s_i`, with offset `d n` across. Two sides touch,
//! the one along `+n` and the one along `-n` (in a lumen wider than the ring only the first can):
//!
//! ```text
//! p = ±d + ρ - R(s_i, φ, t)                     penetration, m
//! g = ∇p = ±n - R_s T - (R_φ/d) e_φ             T: tangent of the centre line
//! F_n = max(0, k p + c ṗ)      ṗ = g·v - R_t     k, c: half of the ring's, so that a full squeeze gives the ring's
//! force on the capsule = -F_n g
//! ```
//!
//! k is the segment's stiffness, which with c, F0 and c_v below belongs to a capsule's surface (others have them by the ratio of theirs), times `1 + contraction_stiffening x closed fraction`: muscle in tone is stiff.
//!
//! The normal force is, at a given tone, the gradient of ½kp², so a wall at rest neither gives nor takes energy but by its damping, and where
//! the lumen opens towards the anus (`R_s > 0`, behind a contraction's centre that comes from the mouth) it pushes by
//! `F_n R_s` along the tract. Friction acts at the capsule's surface along the wall, against the velocity relative to the wall's
//! (which moves by `R_t` radially):
//!
//! ```text
//! γ = (μ F_n + F0 share) tanh(|v_t|/v0)/|v_t| + c_v wrap/5        f = -γ v_t
//! ```
//!
//! `F0` and `c_v` belong to the capsule as a whole: `F0` is shared by the rings that touch, `c_v` goes with the part of each
//! ring's circumference that the wall covers: the arc of the circle ρ that lies outside the circle R.
//!
//! **Taut tissue.** Where a ring presses more than 2 mm into the *resting* wall (with its diverticula), a stiff spring joins in, with `q` the offset
//! of the ring less `max(R_rest - ρ, 0) + 2 mm`; that of the middle grows stiffer:
//!
//! ```text
//! F = k_t (1 + q/q_t)(q + dt q̇⁺) + c q̇⁺        k_t = 1 kN/m, q_t = 0.25 mm: 5 N at the tolerance of 3 mm
//! ```
//!
//! Without it at the ends a capsule that is pushed into a tight bend turns across the lumen, where both ends press along its axis and nothing
//! turns it back.
//!
//! **Tight bends.** A ring's foot is looked for where it was a step ago, beside the middle's, and bends that are tighter than the capsule give way
//! ([`super::bends`]).
//!
//! **Implicit.** With c_v = 15 N s/m on 3.3 g an explicit step of 1/240 s would amplify by 19. Here `F_n` is taken at the end of
//! the step (`p + dt ṗ⁺`, `ṗ⁺`), and γ by a fixed-point iteration on the end's velocity; each iteration is a symmetric positive
//! definite system of six velocities ([`super::system`]). Concave friction makes the iteration monotone.
//!
//! Neglected: the factor 1/(1 - κ d) of the arc length on bends, the wall's inertia and axial motion, suction.

use super::EngineConfig;
use super::bends::{Bends, Chord};
use super::foot::Foot;
use super::system::{Row, System, Twist};
use lumenav_anatomy::centre_line::Station;
use lumenav_anatomy::lumen::Lumen;
use lumenav_anatomy::segment::Wall;
use lumenav_anatomy::tract::Tract;
use lumenav_core::CapsuleBody;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

/// Rings along the capsule.
pub(crate) const RINGS: usize = 5;
/// Two sides of each ring, the taut tissue beyond, and a dome at an end.
const MOST_CONTACTS: usize = 3 * RINGS + 2;
/// Penetration over which the damping of a new contact sets in, m.
const DAMPING_ONSET_M: f64 = 1e-4;
/// Penetration over which adhesion sets in, m: small beside the 40 to 80 um that a capsule's own weight gives.
const ADHESION_ONSET_M: f64 = 1e-6;
/// Offsets below this have no direction, m.
const CENTRED_M: f64 = 1e-9;
/// A ring's foot lies at most this factor of its place along the capsule, and that much more (m), from the foot of the centre: on
/// the inner side of a bend feet are further apart than rings.
const MOST_STRETCH: f64 = 1.5;
const SPARE_M: f64 = 2e-3;
/// How far the capsule's middle presses into the resting wall before the tissue is taut, m [the wall gives way by 2 to 3 mm by design].
const COMPLIANT_M: f64 = 2e-3;
/// Stiffness of taut tissue, N/m: at the tolerance of 3 mm it bears 5 N, ten times the largest force of a magnet or a wave (B).
const TAUT_NEWTON_PER_M: f64 = 1000.0;
/// Penetration over which that doubles, m.
const TAUTER_M: f64 = 0.25e-3;
/// `q/q_t` for a capsule that comes from further away than a step ago: what it has at the tolerance.
const TAUT_IN_ADVANCE: f64 = 4.0;
/// Its damping, N s/m, that of a ring (B).
const TAUT_NEWTON_S_PER_M: f64 = 8.0;
/// Iterations of friction and of which contacts push.
const MOST_ITERATIONS: usize = 8;
/// Relative and absolute change of a slip at which the iteration ends.
const SLIP_TOLERANCE: f64 = 2e-2;
const SLIP_TOLERANCE_M_S: f64 = 1e-7;

/// Places and radii of the rings, m: along the capsule's x axis from its centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rings {
    pub(crate) offset_m: [f64; RINGS],
    pub(crate) radius_m: [f64; RINGS],
    /// Centre of the front dome: half of the cylinder.
    pub(crate) dome: f64,
    capsule_radius_m: f64,
}

impl Rings {
    pub(crate) fn of(capsule: &CapsuleBody) -> Self {
        let r = capsule.radius_m;
        let dome = 0.5 * capsule.length_m - r;
        let tip_m = dome + FRAC_1_SQRT_2 * r;
        Self {
            offset_m: [-tip_m, -dome, 0.0, dome, tip_m],
            radius_m: [FRAC_1_SQRT_2 * r, r, r, r, FRAC_1_SQRT_2 * r],
            dome,
            capsule_radius_m: r,
        }
    }

    /// Half of the length over which the wall is asked, m.
    pub(crate) fn reach_m(&self) -> f64 {
        self.offset_m[RINGS - 1] + self.capsule_radius_m
    }
}

/// Where the capsule is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placement {
    pub(crate) centre_m: Point3<f64>,
    pub(crate) axis: Vector3<f64>,
    /// Station of the centre's projection.
    pub(crate) station: Station,
    /// Where it would move in this step if nothing touched it, m.
    pub(crate) free_way_m: Vector3<f64>,
}

/// An end of the tract that pushes back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cap {
    pub(crate) position_m: Point3<f64>,
    /// Unit vector out of the tract.
    pub(crate) outwards: Vector3<f64>,
    /// Arc length of the end, m.
    pub(crate) arc_length_m: f64,
}

/// One side of a ring that may touch.
#[derive(Debug, Clone, Copy)]
struct Contact {
    push: Vector3<f64>,
    along: Vector3<f64>,
    around: Vector3<f64>,
    push_row: Row,
    along_row: Row,
    around_row: Row,
    penetration_m: f64,
    /// Radial velocity of the wall, and what of it lies along the wall, m/s.
    wall_radial_m_s: f64,
    wall_along_m_s: f64,
    stiffness_n_m: f64,
    damping_n_s_m: f64,
    viscous_n_s_m: f64,
    adhesion_n: f64,
    ring: usize,
    pushes: bool,
    normal_n: f64,
    slip_m_s: f64,
    friction_n_s_m: f64,
}

/// What the wall did in a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reaction {
    /// Velocities at the end of the step.
    pub(crate) twist: Twist,
    /// Sum of its forces, world, N.
    pub(crate) force_world_n: Vector3<f64>,
    /// Rings that touch, and one more for an end.
    pub(crate) touching: usize,
}

/// The contacts of the present step; kept between steps to allocate nothing.
#[derive(Clone)]
pub(crate) struct WallContacts {
    rings: Rings,
    surface: f64,
    /// Shared by bodies of one shape.
    bends: Arc<Bends>,
    contacts: Vec<Contact>,
    feet_m: [f64; RINGS],
}

impl WallContacts {
    /// For a body with these rings in `tract`; `surface`: its surface over the capsule's, to which stiffness, damping, F0 and c_v belong.
    pub(crate) fn new(rings: Rings, tract: &Tract, surface: f64) -> Self {
        let bends = Arc::new(Bends::of(tract, &rings));
        Self { rings, surface, bends, contacts: Vec::with_capacity(MOST_CONTACTS), feet_m: [0.0; RINGS] }
    }

    /// How far the feet of the rings were from the middle's in the last step, along the centre line, m.
    pub(crate) fn feet_m(&self) -> &[f64; RINGS] {
        &self.feet_m
    }

    pub(crate) fn set_feet_m(&mut self, feet_m: [f64; RINGS]) {
        self.feet_m = feet_m;
    }

    pub(crate) fn rings(&self) -> &Rings {
        &self.rings
    }

    /// Its surface over the capsule's.
    pub(crate) fn surface(&self) -> f64 {
        self.surface
    }

    /// Finds what touches. `lumen` is focused on the capsule and the present time.
    pub(crate) fn find<'a>(
        &mut self,
        lumen: &Lumen,
        placement: &Placement,
        wall: &Wall,
        config: &EngineConfig,
        ends: impl Iterator<Item = &'a Cap>,
    ) {
        self.contacts.clear();
        let chord = self.bends.chord(placement.station.arc_length_m);
        for ring in 0..RINGS {
            let foot = self.foot_of(ring, lumen, placement, chord.as_ref());
            self.touch_ring(ring, &foot, lumen, wall, config);
            if ring != RINGS / 2 {
                self.touch_taut(ring, &foot, lumen);
            }
        }
        self.share_adhesion(wall.grip * config.coulomb_newton.0 * self.surface);
        self.touch_backstop(lumen, placement);
        for cap in ends {
            self.touch_cap(cap, placement, config);
        }
    }

    /// Where a ring is in the lumen.
    fn foot_of(&mut self, ring: usize, lumen: &Lumen, placement: &Placement, chord: Option<&Chord>) -> Foot {
        let along_m = self.rings.offset_m[ring];
        let lever = placement.axis * along_m;
        let point = placement.centre_m + lever;
        let middle = &placement.station;
        if ring == RINGS / 2 {
            return Foot::at(middle, &point, lever);
        }
        let line = &lumen.tract().centre_line;
        let straight_m = along_m * placement.axis.dot(&middle.tangent);
        let spare_m = SPARE_M + (MOST_STRETCH - 1.0) * along_m.abs();
        let before_m = self.feet_m[ring];
        let hint_m = if (before_m - straight_m).abs() <= spare_m { before_m } else { straight_m };
        let found = line.quick_foot(&point, middle.arc_length_m + hint_m);
        // A ring's foot beyond this belongs to another loop of the bowel.
        let reach_m = along_m.abs() + spare_m;
        let s = found.arc_length_m.clamp(middle.arc_length_m - reach_m, middle.arc_length_m + reach_m);
        self.feet_m[ring] = s - middle.arc_length_m;
        let foot = if s != found.arc_length_m || lumen.depends_on_angle() {
            Foot::at(&line.station(s), &point, lever)
        } else {
            Foot::of(&found, middle.normal, &point, lever)
        };
        match chord {
            None => foot,
            Some(chord) => foot.blend(&Foot::on(chord, middle, &point, lever), chord.gives),
        }
    }

    fn touch_ring(&mut self, ring: usize, foot: &Foot, lumen: &Lumen, wall: &Wall, config: &EngineConfig) {
        let Foot { arc_length_m, tangent, across, lever, .. } = *foot;
        let offset_m = across.norm_squared().sqrt();
        let n = if offset_m > CENTRED_M { across / offset_m } else { foot.sideways() };
        let radius_m = self.rings.radius_m[ring];
        let angle_rad = angle_of(&n, foot, lumen);
        let mut covered = 0.0;
        let first = self.contacts.len();
        let sides_differ = lumen.depends_on_angle();
        let mut sample = lumen.radius_near(arc_length_m, angle_rad);
        for side in [1.0, -1.0] {
            // The far side touches only where the lumen is narrower than the ring, whose other side then touches too.
            if side < 0.0 && self.contacts.len() == first {
                break;
            }
            if side < 0.0 && sides_differ {
                sample = lumen.radius_near(arc_length_m, angle_rad + PI);
            }
            let penetration_m = side * offset_m + radius_m - sample.radius_m;
            if penetration_m <= 0.0 {
                break;
            }
            covered = covered_fraction(sample.radius_m, offset_m, radius_m);
            let out = n * side;
            let around = tangent.cross(&out);
            let twist_slope = if offset_m > CENTRED_M { sample.d_dangle_m / sample.radius_m } else { 0.0 };
            let steepness = 1.0 / (1.0 + sample.d_ds * sample.d_ds).sqrt();
            let along = (tangent + out * sample.d_ds) * steepness;
            let push = out - tangent * sample.d_ds - around * twist_slope;
            let surface = lever + out * radius_m;
            self.contacts.push(Contact {
                push,
                along,
                around,
                push_row: Row::new(&push, &lever),
                along_row: Row::new(&along, &surface),
                around_row: Row::new(&around, &surface),
                penetration_m,
                wall_radial_m_s: sample.d_dt_m_s,
                wall_along_m_s: sample.d_dt_m_s * sample.d_ds * steepness,
                stiffness_n_m: 0.5
                    * wall.stiffness_newton_per_m
                    * (1.0 + config.contraction_stiffening.0 * sample.closed)
                    * self.surface,
                damping_n_s_m: 0.5
                    * wall.damping_newton_s_per_m
                    * (penetration_m / DAMPING_ONSET_M).min(1.0)
                    * self.surface,
                viscous_n_s_m: 0.0,
                adhesion_n: 0.0,
                ring,
                pushes: true,
                normal_n: 0.0,
                slip_m_s: 0.0,
                friction_n_s_m: 0.0,
            });
        }
        // A collapsed lumen lies around the capsule wherever it is: the engine sees to that.
        let share_of_wall = if wall.collapsed { 0.0 } else { wall.grip * covered };
        let viscous = config.viscous_newton_s_per_m.0 * self.surface * share_of_wall / RINGS as f64;
        let found = &mut self.contacts[first..];
        let share = viscous / found.len().max(1) as f64;
        for contact in found {
            contact.viscous_n_s_m = share;
        }
    }

    /// Shares F0 among the rings that touch, by how firmly they do.
    fn share_adhesion(&mut self, adhesion_n: f64) {
        let grip = |contact: &Contact| (contact.penetration_m / ADHESION_ONSET_M).min(1.0);
        let sum: f64 = self.contacts.iter().map(grip).sum();
        let unit_n = adhesion_n / sum.max(1.0);
        for contact in &mut self.contacts {
            contact.adhesion_n = unit_n * grip(contact);
        }
    }

    /// Beyond the compliant layer of the resting wall the tissue is taut: an end of the capsule does not stand across the lumen.
    fn touch_taut(&mut self, ring: usize, foot: &Foot, lumen: &Lumen) {
        let offset_m = foot.across.norm_squared().sqrt();
        // Nearer than this no tissue is taut.
        if offset_m <= COMPLIANT_M {
            return;
        }
        let out = foot.across / offset_m;
        let limit = TautLimit::of(lumen, foot, &out, self.rings.radius_m[ring]);
        if offset_m > limit.offset_m {
            self.push_taut(ring, foot, &out, offset_m - limit.offset_m, &limit, 0.0);
        }
    }

    /// The same for the middle, whatever the rings before and behind do, and stiffer the further it goes.
    fn touch_backstop(&mut self, lumen: &Lumen, placement: &Placement) {
        let foot = Foot::at(&placement.station, &placement.centre_m, Vector3::zeros());
        let offset_m = foot.across.norm_squared().sqrt();
        let limit_towards =
            |out: &Vector3<f64>| TautLimit::of(lumen, &foot, out, self.rings.capsule_radius_m);
        if offset_m > COMPLIANT_M {
            let out = foot.across / offset_m;
            let limit = limit_towards(&out);
            if offset_m > limit.offset_m {
                let q_m = offset_m - limit.offset_m;
                return self.push_taut(RINGS / 2, &foot, &out, q_m, &limit, q_m / TAUTER_M);
            }
        }
        // A capsule that would come this far within the step meets it before its end: whatever pulls, it does not tunnel.
        let way = placement.free_way_m;
        let ahead = foot.across + way - foot.tangent * foot.tangent.dot(&way);
        let ahead_m = ahead.norm_squared().sqrt();
        if ahead_m <= COMPLIANT_M {
            return;
        }
        let out = ahead / ahead_m;
        let limit = limit_towards(&out);
        if ahead_m > limit.offset_m {
            let penetration_m = out.dot(&foot.across) - limit.offset_m;
            self.push_taut(RINGS / 2, &foot, &out, penetration_m, &limit, TAUT_IN_ADVANCE);
        }
    }

    fn push_taut(
        &mut self,
        ring: usize,
        foot: &Foot,
        out: &Vector3<f64>,
        penetration_m: f64,
        limit: &TautLimit,
        tautness: f64,
    ) {
        let push = out - foot.tangent * limit.d_ds - foot.tangent.cross(out) * limit.twist;
        let zero = Row::new(&Vector3::zeros(), &Vector3::zeros());
        self.contacts.push(Contact {
            push,
            along: Vector3::zeros(),
            around: Vector3::zeros(),
            push_row: Row::new(&push, &foot.lever),
            along_row: zero,
            around_row: zero,
            penetration_m,
            wall_radial_m_s: 0.0,
            wall_along_m_s: 0.0,
            stiffness_n_m: TAUT_NEWTON_PER_M * (1.0 + tautness),
            damping_n_s_m: TAUT_NEWTON_S_PER_M * (penetration_m / DAMPING_ONSET_M).clamp(0.0, 1.0),
            viscous_n_s_m: 0.0,
            adhesion_n: 0.0,
            ring,
            pushes: true,
            normal_n: 0.0,
            slip_m_s: 0.0,
            friction_n_s_m: 0.0,
        });
    }

    fn touch_cap(&mut self, cap: &Cap, placement: &Placement, config: &EngineConfig) {
        // The end's plane goes on for ever, its wall does not: a loop of bowel may cross that plane elsewhere.
        if (placement.station.arc_length_m - cap.arc_length_m).abs() > 2.0 * self.rings.reach_m() {
            return;
        }
        let side = if placement.axis.dot(&cap.outwards) >= 0.0 { 1.0 } else { -1.0 };
        let lever = placement.axis * (side * self.rings.dome);
        let beyond_m = (placement.centre_m + lever - cap.position_m).dot(&cap.outwards);
        let penetration_m = beyond_m + self.rings.capsule_radius_m;
        if penetration_m <= 0.0 {
            return;
        }
        let row = Row::new(&cap.outwards, &lever);
        self.contacts.push(Contact {
            push: cap.outwards,
            along: Vector3::zeros(),
            around: Vector3::zeros(),
            push_row: row,
            along_row: Row::new(&Vector3::zeros(), &lever),
            around_row: Row::new(&Vector3::zeros(), &lever),
            penetration_m,
            wall_radial_m_s: 0.0,
            wall_along_m_s: 0.0,
            stiffness_n_m: config.cap_stiffness_newton_per_m.0,
            damping_n_s_m: config.cap_damping_newton_s_per_m.0 * (penetration_m / DAMPING_ONSET_M).min(1.0),
            viscous_n_s_m: 0.0,
            adhesion_n: 0.0,
            ring: RINGS,
            pushes: true,
            normal_n: 0.0,
            slip_m_s: 0.0,
            friction_n_s_m: 0.0,
        });
    }

    /// Solves for the velocities at the end of a step that starts with `twist`; `system` holds everything but the wall.
    pub(crate) fn solve(
        &mut self,
        system: &System,
        twist: &Twist,
        friction: f64,
        config: &EngineConfig,
        step_s: f64,
    ) -> Reaction {
        let mut new = *twist;
        if self.contacts.is_empty() {
            return Reaction { twist: system.solve(), force_world_n: Vector3::zeros(), touching: 0 };
        }
        self.update(&new, friction, config, step_s);
        for _ in 0..MOST_ITERATIONS {
            let mut filled = *system;
            self.add_to(&mut filled, step_s);
            new = filled.solve();
            if self.update(&new, friction, config, step_s) {
                break;
            }
        }
        self.reaction(new)
    }

    /// Takes the forces from `twist`; whether they stayed what the last solve used.
    pub(crate) fn update(
        &mut self,
        twist: &Twist,
        friction: f64,
        config: &EngineConfig,
        step_s: f64,
    ) -> bool {
        let mut settled = true;
        for contact in &mut self.contacts {
            settled &= contact.update(twist, friction, config, step_s);
        }
        settled
    }

    /// Adds what the wall does to a body's system.
    pub(crate) fn add_to(&self, system: &mut System, step_s: f64) {
        for contact in &self.contacts {
            contact.add_to(system, step_s);
        }
    }

    /// What the wall does at these velocities.
    pub(crate) fn reaction(&self, twist: Twist) -> Reaction {
        let mut force_world_n = Vector3::zeros();
        let mut touched = [false; RINGS + 1];
        for contact in &self.contacts {
            force_world_n -= contact.push * contact.normal_n
                + contact.along
                    * (contact.friction_n_s_m
                        * (contact.along_row.velocity(&twist) - contact.wall_along_m_s))
                + contact.around * (contact.friction_n_s_m * contact.around_row.velocity(&twist));
            touched[contact.ring] = true;
        }
        Reaction { twist, force_world_n, touching: touched.iter().filter(|ring| **ring).count() }
    }
}

impl Contact {
    /// Takes normal force and friction from `twist`; whether they stayed what the last solve used.
    fn update(&mut self, twist: &Twist, mu: f64, config: &EngineConfig, step_s: f64) -> bool {
        let approach_m_s = self.push_row.velocity(twist) - self.wall_radial_m_s;
        let normal_n = self.stiffness_n_m * (self.penetration_m + step_s * approach_m_s)
            + self.damping_n_s_m * approach_m_s;
        let pushes = normal_n > 0.0;
        let mut settled = pushes == self.pushes;
        self.pushes = pushes;
        self.normal_n = normal_n.max(0.0);
        let along = self.along_row.velocity(twist) - self.wall_along_m_s;
        let around = self.around_row.velocity(twist);
        let slip_m_s = (along * along + around * around).sqrt();
        settled &= (slip_m_s - self.slip_m_s).abs() <= SLIP_TOLERANCE * slip_m_s + SLIP_TOLERANCE_M_S;
        self.slip_m_s = slip_m_s;
        let coulomb_n = mu * self.normal_n + if pushes { self.adhesion_n } else { 0.0 };
        let v0 = config.regularisation_m_s.0;
        let x = slip_m_s / v0;
        // tanh(x)/x is 1 to rounding below 1e-8.
        let secant = if x < 1e-8 { 1.0 / v0 } else { x.tanh() / slip_m_s };
        self.friction_n_s_m = coulomb_n * secant + if pushes { self.viscous_n_s_m } else { 0.0 };
        settled
    }

    fn add_to(&self, system: &mut System, step_s: f64) {
        if !self.pushes {
            return;
        }
        let rate = self.stiffness_n_m * step_s + self.damping_n_s_m;
        let resting_n = self.stiffness_n_m * self.penetration_m - rate * self.wall_radial_m_s;
        system.add_row(&self.push_row, step_s * rate, -step_s * resting_n);
        if self.friction_n_s_m > 0.0 {
            let weight = step_s * self.friction_n_s_m;
            system.add_row(&self.along_row, weight, weight * self.wall_along_m_s);
            system.add_row(&self.around_row, weight, 0.0);
        }
    }
}

/// Angle of a direction across the tract from the station's normal towards its binormal; 0 where the lumen is round.
fn angle_of(out: &Vector3<f64>, foot: &Foot, lumen: &Lumen) -> f64 {
    if lumen.depends_on_angle() {
        out.dot(&foot.tangent.cross(&foot.normal)).atan2(out.dot(&foot.normal))
    } else {
        0.0
    }
}

/// How far off the centre line a ring may be before the resting tissue is taut.
struct TautLimit {
    offset_m: f64,
    /// How it widens along the tract.
    d_ds: f64,
    /// How it widens around it, per length.
    twist: f64,
}

impl TautLimit {
    /// Of a ring of this radius, in a direction across the tract.
    fn of(lumen: &Lumen, foot: &Foot, out: &Vector3<f64>, ring_m: f64) -> Self {
        let outermost = lumen.outermost(foot.arc_length_m, angle_of(out, foot, lumen));
        let play_m = outermost.x - ring_m;
        if play_m > 0.0 {
            let offset_m = play_m + COMPLIANT_M;
            Self { offset_m, d_ds: outermost.y, twist: outermost.z / offset_m }
        } else {
            Self { offset_m: COMPLIANT_M, d_ds: 0.0, twist: 0.0 }
        }
    }
}

/// S(y) = 3y² - 2y³, clamped.
pub(crate) fn smooth_step(y: f64) -> f64 {
    let y = y.clamp(0.0, 1.0);
    y * y * (3.0 - 2.0 * y)
}

/// Part of the circle of radius `ring_m`, `offset_m` off the centre, that lies outside the circle of radius `lumen_m`.
fn covered_fraction(lumen_m: f64, offset_m: f64, ring_m: f64) -> f64 {
    let cosine =
        (lumen_m * lumen_m - offset_m * offset_m - ring_m * ring_m) / (2.0 * offset_m * ring_m).max(1e-18);
    cosine.clamp(-1.0, 1.0).acos() / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_covered_fraction() {
        // Concentric and squeezed: all of it. Free: none. Equal circles one radius apart: outside is 2/3 of the circle.
        assert!((covered_fraction(0.004, 0.0, 0.0055) - 1.0).abs() < 1e-12);
        assert!(covered_fraction(0.02, 0.0, 0.0055).abs() < 1e-12);
        assert!(covered_fraction(0.02, 0.0145, 0.0055).abs() < 1e-6);
        assert!((covered_fraction(0.01, 0.01, 0.01) - 2.0 / 3.0).abs() < 1e-12);
    }
}
