//! A small seeded generator of windows, a motion filter and a score: for tests, benches and tables of the trackers only.
//!
//! Lines are made in one of two ways: `Ends::Law` draws each end's error from a core and a tail in its block's frame (fast; heavy
//! tails, but the law is the tracker's own), `Ends::Physics` follows both photons through the blocks' crystals (the tracker's law
//! is then an approximation, as with real data). Background lines pass the capsule at a distance with
//! Rayleigh's law, as the simulator's scattered and random lines do. Directions are those that both blocks of a pair can see.

use lumenav_core::pose::{exp_so3, ominus, oplus};
use lumenav_core::{Node, PriorUse, RandomStream, RandomStreams};
use lumenav_pet::simulation::block::{BlockPhysics, passes_window};
use lumenav_pet::simulation::{Photon, Scintillator};
use lumenav_pet::tracking::{
    BlockErrors, BlockNoise, LineNoise, Prior, Reinitialized, SourceNoise, Tracked, Tracker,
};
use lumenav_pet::{CrystalIndex, Line, MarkerSet, Scanner};
use nalgebra::{Isometry3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::RngExt as _;
use rand_distr::{Distribution as _, Gamma, StandardNormal};
use std::path::Path;

pub fn model(folder: &str, name: &str) -> Node {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
    Node::open(&models.join(folder).join(format!("{name}.toml"))).expect("a shipped model")
}

pub fn scanner(name: &str) -> Scanner {
    let scanner = Scanner::from_node(&model("scanners", name)).expect("a shipped scanner");
    scanner.clone().with_interaction_depth(&scintillator(&scanner))
}

pub fn scintillator(scanner: &Scanner) -> Scintillator {
    let name = scanner.detection.scintillator.to_string();
    Scintillator::from_node(&model("scintillators", &name)).expect("a shipped scintillator")
}

pub fn triangle() -> MarkerSet {
    capsule("pet-triangle")
}

pub fn capsule(name: &str) -> MarkerSet {
    MarkerSet::from_capsule(&model("capsules", name), "pet", 3).expect("a shipped capsule")
}

/// Markers at these places, mm.
pub fn set(places_mm: &[[f64; 3]]) -> MarkerSet {
    let mut set = triangle();
    let first = set.markers[0].clone();
    set.markers = places_mm
        .iter()
        .map(|p| lumenav_pet::Marker { position_capsule_m: Vector3::from(*p) * 1e-3, ..first.clone() })
        .collect();
    set
}

/// How the ends of true lines come about.
pub enum Ends {
    Law(BlockNoise),
    Physics(BlockPhysics),
}

impl Ends {
    pub fn physics(scanner: &Scanner) -> Self {
        Self::Physics(BlockPhysics::new(scanner, scintillator(scanner)))
    }
}

pub struct Generator {
    pub scanner: Scanner,
    pub ends: Ends,
    pub markers: MarkerSet,
    random: RandomStream,
}

/// The window of than2015, s.
pub const WINDOW_S: f64 = 0.05;

impl Generator {
    pub fn new(scanner: Scanner, ends: Ends, markers: MarkerSet, seed: u64) -> Self {
        let random = RandomStreams::new(seed, 0, "generator").stream("lines", 0);
        Self { scanner, ends, markers, random }
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    fn isotropic(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()).normalize()
    }

    /// Lines of a window in a random order, with the marker that each came from.
    pub fn window(
        &mut self,
        motion: &dyn Fn(f64) -> Isometry3<f64>,
        start_s: f64,
        trues: usize,
        background: usize,
    ) -> (Vec<Line>, Vec<Option<usize>>) {
        let mut all: Vec<(Line, Option<usize>)> = Vec::new();
        let total = self.markers.total_activity_bq();
        while all.len() < trues {
            let t_s = start_s + WINDOW_S * self.random.random::<f64>();
            let mut rest = total * self.random.random::<f64>();
            let marker = self
                .markers
                .markers
                .iter()
                .position(|m| {
                    rest -= m.activity_bq;
                    rest <= 0.0
                })
                .unwrap_or(0);
            let pose = motion(t_s);
            let at = pose.transform_point(&self.markers.markers[marker].position_capsule_m.into()).coords;
            if let Some(line) = self.line_from(&at, t_s) {
                all.push((line, Some(marker)));
            }
        }
        for _ in 0..background {
            let t_s = start_s + WINDOW_S * self.random.random::<f64>();
            let centre = motion(t_s).translation.vector;
            all.push((self.stray(&centre, t_s), None));
        }
        all.sort_by(|a, b| a.0.t_s.total_cmp(&b.0.t_s));
        all.into_iter().unzip()
    }

    /// A Poisson number of lines about a mean, a share of them true.
    pub fn poisson_window(
        &mut self,
        motion: &dyn Fn(f64) -> Isometry3<f64>,
        start_s: f64,
        mean: f64,
        true_share: f64,
    ) -> Vec<Line> {
        let count = |m: f64, random: &mut RandomStream| -> usize {
            rand_distr::Poisson::new(m).map_or(0.0, |p| p.sample(random)) as usize
        };
        let trues = count(mean * true_share, &mut self.random);
        let background = count(mean * (1.0 - true_share), &mut self.random);
        self.window(motion, start_s, trues, background).0
    }

    /// A pair of blocks that can coincide, and a place on the face of the first.
    fn aim(&mut self) -> (usize, Vector3<f64>) {
        let block = self.random.random_range(0..self.scanner.blocks.len());
        let g = self.scanner.grid;
        let h = g.half_width_m() * (2.0 * self.random.random::<f64>() - 1.0);
        let z = g.half_length_m() * (2.0 * self.random.random::<f64>() - 1.0);
        (block, self.scanner.in_block(block, h, z, 0.0))
    }

    /// The block that a ray meets first, and where on its face.
    fn hit(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(usize, Vector3<f64>)> {
        let g = self.scanner.grid;
        (0..self.scanner.blocks.len()).find_map(|b| {
            let block = &self.scanner.blocks[b];
            let speed = direction.dot(&block.outward);
            let along = (block.centre_world_m - from).dot(&block.outward) / speed;
            if speed <= 0.0 || along <= 0.0 {
                return None;
            }
            let place = from + direction * along;
            let local = self.scanner.to_block(b, &place);
            (local.x.abs() < g.half_width_m() && local.y.abs() < g.half_length_m()).then_some((b, place))
        })
    }

    fn line_from(&mut self, marker: &Vector3<f64>, t_s: f64) -> Option<Line> {
        // Range: Gamma(2, 0.2 mm), core of 0.5 mm (reference A).
        let range = Gamma::new(2.0, 0.2e-3).expect("a valid law").sample(&mut self.random);
        let core = 0.25e-3 * self.random.random::<f64>().cbrt();
        let from = marker + self.isotropic() * range + self.isotropic() * core;
        let (first, aimed) = self.aim();
        let direction = (aimed - from).normalize();
        // The solid angle of a place on the face: cos / r².
        let cosine = direction.dot(&self.scanner.blocks[first].outward);
        let r = (aimed - from).norm();
        if cosine <= 0.0 || self.random.random::<f64>() > cosine * (0.3 / r).powi(2) {
            return None;
        }
        let bend = 0.5_f64.to_radians() / 2.354820045030949;
        let away = Vector3::new(self.normal(), self.normal(), self.normal()) * bend;
        let back = (away - direction - direction * away.dot(&direction)).normalize();
        let (second, across) = self.hit(&from, &back)?;
        if !self.scanner.can_coincide(first, second) {
            return None;
        }
        let a = self.end(first, &from, &direction, &aimed)?;
        let b = self.end(second, &from, &back, &across)?;
        Some(Line { t_s, ends_world_m: [a, b] })
    }

    fn end(
        &mut self,
        block: usize,
        from: &Vector3<f64>,
        direction: &Vector3<f64>,
        on_face: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        match &self.ends {
            Ends::Law(law) => {
                let v = if self.random.random::<f64>() < law.tail_share { law.tail_m2 } else { law.core_m2 };
                let depth = self.scanner.told_depth_m();
                let outward = self.scanner.blocks[block].outward;
                let middle = on_face + direction * (depth / direction.dot(&outward));
                let mut error = Vector3::zeros();
                for (i, v) in v.iter().enumerate() {
                    let z: f64 = StandardNormal.sample(&mut self.random);
                    error[i] = v.sqrt() * z;
                }
                let local = self.scanner.to_block(block, &middle) + error;
                Some(self.scanner.in_block(block, local.x, local.y, local.z))
            }
            Ends::Physics(physics) => {
                let b = &self.scanner.blocks[block];
                let turned = Vector3::new(
                    direction.dot(&b.tangential),
                    direction.dot(&b.axial),
                    direction.dot(&b.outward),
                );
                let mut photon = Photon::emitted(self.scanner.to_block(block, from), turned, 510_998.95);
                let deposit = physics.respond(&mut photon, &mut self.random)?;
                if !passes_window(&self.scanner.detection, deposit.energy_ev, &mut self.random) {
                    return None;
                }
                let (column, row) = deposit.crystal;
                self.scanner
                    .position(CrystalIndex { x: block as u32 * self.scanner.grid.columns + column, z: row })
            }
        }
    }

    /// A line that has nothing to do with a marker.
    fn stray(&mut self, centre: &Vector3<f64>, t_s: f64) -> Line {
        loop {
            let (first, a) = self.aim();
            let (second, b) = self.aim();
            if !self.scanner.can_coincide(first, second) {
                continue;
            }
            let n = (b - a).normalize();
            let (e1, e2) = lumenav_core::pose::tangent_basis(&n);
            // Impact parameters of corrupted lines, reduced scanner: 20, 33, 53, 74, 91 mm, which is Rayleigh's law of 45 mm.
            let r = 0.045 * (-2.0 * (1.0 - self.random.random::<f64>()).ln()).sqrt();
            let turn = std::f64::consts::TAU * self.random.random::<f64>();
            let through = centre + e1 * (r * turn.cos()) + e2 * (r * turn.sin());
            let half = 0.5 * (b - a).norm();
            return Line { t_s, ends_world_m: [through - n * half, through + n * half] };
        }
    }
}

/// The helix of than2015, section 4.3: 5 mm/s around, 2.5 mm/s along z, 36 s, radius 57 mm, `speed` times as fast; the capsule
/// points along its way.
pub fn helix(t_s: f64, speed: f64) -> Isometry3<f64> {
    let radius_m = 0.057;
    let t = t_s * speed;
    let angle = 5e-3 * t / radius_m;
    let place = Translation3::new(radius_m * angle.cos(), radius_m * angle.sin(), -0.045 + 2.5e-3 * t);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle + std::f64::consts::FRAC_PI_2)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -(0.5_f64.atan()));
    Isometry3::from_parts(place, turn)
}

/// Mean and largest distance of the markers from their places, m; the two base markers of the triangle may be exchanged.
pub fn marker_errors(found: &[Vector3<f64>], truth: &Isometry3<f64>, set: &MarkerSet) -> (f64, f64) {
    let places: Vec<Vector3<f64>> =
        set.positions_capsule_m().iter().map(|m| truth.transform_point(&(*m).into()).coords).collect();
    let score = |order: &[usize]| {
        let d: Vec<f64> = found.iter().zip(order).map(|(f, i)| (f - places[*i]).norm()).collect();
        (d.iter().sum::<f64>() / d.len() as f64, d.iter().copied().fold(0.0, f64::max))
    };
    let straight: Vec<usize> = (0..found.len()).collect();
    let swapped: Vec<usize> = straight.iter().map(|i| [0, 2, 1].get(*i).copied().unwrap_or(*i)).collect();
    let (a, b) = (score(&straight), score(&swapped));
    if b.0 < a.0 && found.len() == 3 { b } else { a }
}

type Matrix12 = SMatrix<f64, 12, 12>;

/// Constant velocity with white acceleration, around a tracker that takes its prior as contained. For development only: fusion owns
/// motion filters.
pub struct MotionFilter {
    pub acceleration_m_s2: f64,
    pub acceleration_rad_s2: f64,
    state: Option<(Isometry3<f64>, Vector6<f64>, Matrix12)>,
}

impl MotionFilter {
    /// 30 mm/s² and 1 rad/s²: the study's setting.
    pub fn new(acceleration_m_s2: f64, acceleration_rad_s2: f64) -> Self {
        Self { acceleration_m_s2, acceleration_rad_s2, state: None }
    }

    fn start(&mut self, tracked: &Tracked) {
        let mut p = Matrix12::zeros();
        p.fixed_view_mut::<6, 6>(0, 0).copy_from(&tracked.covariance);
        for i in 6..9 {
            p[(i, i)] = 0.03_f64.powi(2);
        }
        for i in 9..12 {
            p[(i, i)] = 1.0;
        }
        self.state = Some((tracked.world_from_capsule, Vector6::zeros(), p));
    }

    fn predict(&self, dt: f64) -> Option<(Isometry3<f64>, Vector6<f64>, Matrix12)> {
        let (pose, rate, p) = self.state.as_ref()?;
        let turn = rate.fixed_rows::<3>(3) * dt;
        let mut f = Matrix12::identity();
        for i in 0..6 {
            f[(i, i + 6)] = dt;
        }
        f.fixed_view_mut::<3, 3>(3, 3).copy_from(&exp_so3(&-turn).to_rotation_matrix().into_inner());
        let mut q = Matrix12::zeros();
        for i in 0..6 {
            let a = if i < 3 { self.acceleration_m_s2 } else { self.acceleration_rad_s2 }.powi(2);
            q[(i, i)] = a * dt.powi(4) / 4.0;
            q[(i, i + 6)] = a * dt.powi(3) / 2.0;
            q[(i + 6, i)] = q[(i, i + 6)];
            q[(i + 6, i + 6)] = a * dt * dt;
        }
        Some((oplus(pose, &(rate * dt)), *rate, f * p * f.transpose() + q))
    }

    /// Tracks one window and takes it in.
    pub fn step(
        &mut self,
        tracker: &mut dyn Tracker,
        lines: &[Line],
        dt: f64,
    ) -> Result<Tracked, lumenav_pet::tracking::Failure> {
        let Some((pose, rate, p)) = self.predict(dt) else {
            let tracked = tracker.track(lines, None)?;
            self.start(&tracked);
            return Ok(tracked);
        };
        let prior_cov: Matrix6<f64> = p.fixed_view::<6, 6>(0, 0).into_owned();
        let prior = Prior {
            world_from_capsule: pose,
            covariance: prior_cov,
            velocity_world_m_s: rate.fixed_rows::<3>(0).into_owned(),
            how: PriorUse::Contained,
        };
        let tracked = match tracker.track(lines, Some(&prior)) {
            Ok(tracked) => tracked,
            Err(failure) => {
                self.state = Some((pose, rate, p));
                return Err(failure);
            }
        };
        if matches!(tracked.reinitialized, Some(Reinitialized::Permutation | Reinitialized::LikelihoodFell)) {
            self.start(&tracked);
            return Ok(tracked);
        }
        let moved = ominus(&tracked.world_from_capsule, &pose);
        let inverse = prior_cov.try_inverse().expect("a covariance");
        let gain = p.fixed_view::<6, 6>(6, 0) * inverse;
        let mut after = p;
        let cross = gain * tracked.covariance;
        after.fixed_view_mut::<6, 6>(0, 0).copy_from(&tracked.covariance);
        after.fixed_view_mut::<6, 6>(6, 0).copy_from(&cross);
        after.fixed_view_mut::<6, 6>(0, 6).copy_from(&cross.transpose());
        let less = gain * (prior_cov - tracked.covariance) * gain.transpose();
        let block = p.fixed_view::<6, 6>(6, 6) - less;
        after.fixed_view_mut::<6, 6>(6, 6).copy_from(&block);
        self.state = Some((tracked.world_from_capsule, rate + gain * moved, after));
        Ok(tracked)
    }
}

/// The line noise of a scanner as an estimator computes it.
pub fn noise_of(scanner: &Scanner) -> LineNoise {
    let errors =
        BlockErrors::of_block(scanner, &scintillator(scanner), lumenav_pet::simulation::EndPoints::Crystal);
    LineNoise::of_block(scanner, &errors, &SourceNoise::default())
}

/// The same for lines of [`Ends::physics`], of which the edges of the field cut off none.
pub fn noise_of_drawn(scanner: &Scanner) -> LineNoise {
    let errors =
        BlockErrors::of_block(scanner, &scintillator(scanner), lumenav_pet::simulation::EndPoints::Crystal);
    let mut noise = LineNoise::of_law(scanner, &errors.law, &SourceNoise::default());
    noise.information_share = noise_of(scanner).information_share;
    noise
}

/// The line noise whose law is [`Ends::Law`]'s.
pub fn noise_of_law(scanner: &Scanner, law: &BlockNoise) -> LineNoise {
    LineNoise::of_law(scanner, law, &SourceNoise::default())
}
