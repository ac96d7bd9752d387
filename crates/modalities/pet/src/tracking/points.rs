//! Independent points: tracer particles and calibration sources, each with a place and no attitude.
//!
//! A point is followed by the likelihood of [`super::likelihood`] with one component: among the lines that pass within R
//! ([`LineNoise::background_radius_m`]) of where it was,
//!
//! ```text
//! p_i = (1-β) Σ_k c_ik exp(-½ uᵀ P_ik u) + β / (π R²)
//! ```
//!
//! climbed by damped Newton steps in the three coordinates, β by expectation-maximisation between the steps. Lines of the other
//! points are background to it, and even across R where these are far away: points nearer than 2 R are refused
//! ([`Failure::TooClose`]). The covariance is the inverse of the observed information (Louis 1982), of its share that counts
//! ([`LineNoise::information_share`]).
//!
//! A point that is not known is searched for: of the places where two lines nearly meet, the one that most lines pass is climbed
//! from; then the next point among the lines that pass the found ones by.
//!
//! **Which is which.** Points look alike; they are numbered by x, then y, then z in the first window that shows all of them, and none is
//! answered before ([`Failure::Unnumbered`]), so that trackers shown the same lines give them the same numbers. From then on a
//! number goes with the place: a point that was lost keeps the place where it was last, and what is found anew takes the numbers
//! that are free so that the sum of squared ways by the windows since then, `Σ |now - last|²/t`, is least (Kuhn 1955; the likeliest under a
//! random walk). Where more are lost than are found, one that could nearly as well be another is not answered until those are back
//! too. Points that change places unseen are exchanged; nothing in their lines could tell.

use super::densest::{Densest, PASSING_M, distance_m};
use super::failure::Failure;
use super::likelihood::{Evaluation, Likelihood, Weights};
use super::noise::LineNoise;
use super::window::{Preparation, Window, is_usable};
use super::{Limits, Role};
use crate::line::Line;
use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};
use pathfinding::kuhn_munkres::kuhn_munkres_min;
use pathfinding::matrix::Matrix;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Lines that a point must explain: two per coordinate.
const LINES_NEEDED: usize = 6;
/// Least gain over background alone, log-likelihood; see `mixture`. Chi-square with 3 degrees of freedom, and in a search the best of
/// 100³ places that can be told apart.
const FOLLOWED_GAIN: f64 = 10.5;
const SEARCHED_GAIN: f64 = 24.0;
/// Steps of a climb.
const STEPS: u32 = 40;
/// Longest step, m.
const LONGEST_M: f64 = 8e-3;
/// The climb ends at steps below this, m: far below the noise.
const REST_M: f64 = 1e-6;
/// Information per line that a damped step adds at least, 1/m²: a line of 3 mm standard deviation.
const FLOOR_PER_LINE: f64 = 1.0 / (3e-3 * 3e-3);
/// Background share among the lines that pass near, before any window has told.
const FIRST_BACKGROUND: f64 = 0.3;
/// A point that explains less than this share of what it did is searched for as well.
const FALL: f64 = 0.5;
/// Of fewer points than are lost, one takes a number where every other is so many times as unlikely a way, squared: twice as far.
const CLEARLY: i64 = 4;
/// How fast what a point explains is forgotten, per window.
const FORGETTING: f64 = 0.1;

/// A point in a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedPoint {
    /// Where it is, m.
    pub position_world_m: Vector3<f64>,
    /// Its covariance, m².
    pub covariance_m2: Matrix3<f64>,
    /// Lines that it explains.
    pub lines: f64,
    /// Whether it was searched for in this window.
    pub searched: bool,
}

/// What is kept of a point from window to window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointMemory {
    /// Where it was last, m; `None` before all points were found.
    pub position_world_m: Option<Vector3<f64>>,
    /// Share of a window's lines that it explains.
    pub share: f64,
    /// Windows since one showed it.
    pub unseen: u32,
}

/// Follows a fixed number of points.
#[derive(Clone, Debug)]
pub struct Points {
    noise: LineNoise,
    limits: Limits,
    memory: Vec<PointMemory>,
    likelihood: Likelihood,
    weights: Weights,
    window: Window,
    evaluation: Evaluation,
    /// Where the origin of the scanner's frame stands.
    scanner_world_m: Vector3<f64>,
}

/// Where a climb ended.
struct Top {
    at_m: Vector3<f64>,
    information: Matrix3<f64>,
    lines: f64,
    /// Log-likelihood less that of background alone.
    gain: f64,
    /// Whether the steps came to rest.
    converged: bool,
}

impl Points {
    /// For `count` points in a scanner with this noise.
    pub fn new(count: usize, noise: LineNoise) -> Self {
        Self {
            noise,
            limits: Limits::default(),
            memory: vec![PointMemory::default(); count],
            likelihood: Likelihood::new(vec![Vector3::zeros()]),
            weights: Weights { shares: vec![1.0], background: FIRST_BACKGROUND },
            window: Window::default(),
            evaluation: Evaluation::default(),
            scanner_world_m: Vector3::zeros(),
        }
    }

    /// Where the origin of the scanner's frame stands from now on, world, m: a bed moves it.
    pub fn scanner_at(&mut self, place_world_m: &Vector3<f64>) {
        self.scanner_world_m = *place_world_m;
    }

    /// What it keeps from window to window.
    pub fn memory(&self) -> &[PointMemory] {
        &self.memory
    }

    /// Goes on from a memory; of another number of points it is not looked at.
    pub fn recall(&mut self, memory: &[PointMemory]) {
        if memory.len() == self.memory.len() {
            self.memory.copy_from_slice(memory);
        }
    }

    /// All points of one window, and what each line was taken for.
    pub fn track(&mut self, lines: &[Line]) -> (Vec<Result<TrackedPoint, Failure>>, Vec<Role>) {
        let mut found: Vec<Result<TrackedPoint, Failure>> =
            (0..self.memory.len()).map(|k| self.follow(k, lines)).collect();
        self.refuse_neighbours(&mut found);
        if found.iter().any(Result::is_err) {
            self.search_missing(lines, &mut found);
        }
        self.refuse_unnumbered(&mut found);
        self.learn(lines, &found);
        let roles = self.roles(lines, &found);
        (found, roles)
    }

    /// A climb from where the point was.
    fn follow(&mut self, point: usize, lines: &[Line]) -> Result<TrackedPoint, Failure> {
        let PointMemory { position_world_m, share, unseen } = self.memory[point];
        let Some(start) = position_world_m.filter(|_| unseen == 0) else {
            return Err(Failure::Background { effective: 0.0, background: 100.0, needed: LINES_NEEDED });
        };
        let found = self.climb(lines, &start).and_then(|top| self.judged(&top, lines, false))?;
        if found.lines < FALL * share * lines.len() as f64 {
            return Err(Failure::Background {
                effective: found.lines,
                background: 100.0 * (1.0 - found.lines / lines.len().max(1) as f64),
                needed: (FALL * share * lines.len() as f64).ceil() as usize,
            });
        }
        Ok(found)
    }

    /// Looks for the points that are missing, among the lines that pass the others by.
    fn search_missing(&mut self, lines: &[Line], found: &mut [Result<TrackedPoint, Failure>]) {
        let missing: Vec<usize> = (0..found.len()).filter(|k| found[*k].is_err()).collect();
        let mut known: Vec<Vector3<f64>> = found.iter().flatten().map(|p| p.position_world_m).collect();
        let mut new: Vec<TrackedPoint> = Vec::new();
        let mut why = None;
        for _ in &missing {
            let is_free = |line: &&Line| {
                is_usable(line) && known.iter().all(|at| distance_m(line, at) > 3.0 * PASSING_M)
            };
            let free: Vec<Line> = lines.iter().filter(is_free).copied().collect();
            let Some(start) = Densest::default().find(&free) else { break };
            let top = self.climb(lines, &start).and_then(|top| self.judged(&top, lines, true));
            match top.and_then(|point| self.apart(point, found, &new, &missing)) {
                Ok(point) => {
                    known.push(point.position_world_m);
                    new.push(point);
                }
                Err(failure) => {
                    known.push(start);
                    why.get_or_insert(failure);
                }
            }
        }
        if let Some(why) = why {
            // What a search ended with says more than that the point is gone.
            missing.iter().for_each(|k| found[*k] = Err(why.clone()));
        }
        for (number, point) in self.numbered(&missing, new) {
            found[number] = point;
        }
    }

    /// A new point, unless it is too close to one that is followed or was found before it, and with more lines.
    fn apart(
        &self,
        point: TrackedPoint,
        found: &[Result<TrackedPoint, Failure>],
        new: &[TrackedPoint],
        missing: &[usize],
    ) -> Result<TrackedPoint, Failure> {
        let followed = found.iter().enumerate().filter_map(|(k, p)| Some((k, p.as_ref().ok()?)));
        // Which numbers new points will have is not told yet: they stand in the order in which they were found.
        let mut others = followed.chain(missing.iter().copied().zip(new));
        let apart_m = |other: &TrackedPoint| (point.position_world_m - other.position_world_m).norm();
        match others.find(|(_, other)| apart_m(other) < self.least_apart_m()) {
            Some((number, other)) => {
                let own = missing.get(new.len()).copied().unwrap_or(number);
                Err(self.too_close([number, own], apart_m(other)))
            }
            None => Ok(point),
        }
    }

    /// Nearer points disturb each other's background.
    fn least_apart_m(&self) -> f64 {
        2.0 * self.noise.background_radius_m
    }

    fn too_close(&self, pair: [usize; 2], apart_m: f64) -> Failure {
        Failure::TooClose { pair, distance_mm: 1e3 * apart_m, allowed_mm: 1e3 * self.least_apart_m() }
    }

    /// New points under the free numbers: by place the first time, then with the least squared ways, where these are clear.
    fn numbered(
        &self,
        free: &[usize],
        mut new: Vec<TrackedPoint>,
    ) -> Vec<(usize, Result<TrackedPoint, Failure>)> {
        new.sort_by(|a, b| by_place(&a.position_world_m, &b.position_world_m));
        let last: Option<Vec<_>> = free.iter().map(|k| self.memory[*k].position_world_m).collect();
        let (Some(last), false) = (last, new.is_empty()) else {
            return free.iter().copied().zip(new.into_iter().map(Ok)).collect();
        };
        let squared_um = |new: &TrackedPoint, (number, last): (&usize, &Vector3<f64>)| {
            let windows = f64::from(self.memory[*number].unseen + 1);
            (1e12 * (new.position_world_m - last).norm_squared() / windows).min(1e15) as i64
        };
        let ways: Vec<Vec<i64>> = new
            .iter()
            .map(|point| free.iter().zip(&last).map(|way| squared_um(point, way)).collect())
            .collect();
        // Rows of one length always make a matrix.
        let Ok(matrix) = Matrix::from_rows(ways.clone()) else { return Vec::new() };
        let all_are_back = new.len() == free.len();
        let is_clear = |row: &[i64], column: usize| {
            all_are_back || (0..row.len()).all(|other| other == column || row[column] <= row[other] / CLEARLY)
        };
        let rows = kuhn_munkres_min(&matrix).1.into_iter().zip(&ways).zip(&new);
        rows.map(|((column, row), point)| {
            let unclear = Failure::Unnumbered { found: new.len(), points: free.len() };
            (free[column], if is_clear(row, column) { Ok(*point) } else { Err(unclear) })
        })
        .collect()
    }

    /// To the top of the likelihood.
    fn climb(&mut self, lines: &[Line], start: &Vector3<f64>) -> Result<Top, Failure> {
        let how = Preparation { scanner_world_m: self.scanner_world_m, ..Preparation::about(*start) };
        self.window.prepare(lines, &self.noise, &how, LINES_NEEDED)?;
        let near = self.window.near() as f64;
        self.weights.background = FIRST_BACKGROUND;
        let mut at = *start;
        let mut here = self.evaluate(&at);
        let mut damping = 0.0;
        let mut converged = false;
        for _ in 0..STEPS {
            let gradient = here.gradient.fixed_rows::<3>(0).into_owned();
            let floor = FLOOR_PER_LINE * here.effective_lines().max(1.0);
            let Some(step) = damped(&position_block(&here), &gradient, floor, &mut damping) else { break };
            let there = self.evaluate(&(at + step));
            if there.log_likelihood < here.log_likelihood {
                damping = f64::max(4.0 * damping, 0.1);
                // What is lost by so short a step is rounding.
                converged = step.norm() < REST_M;
                if converged {
                    break;
                }
                continue;
            }
            at += step;
            damping *= 0.25;
            // The share of the background follows; neither side may be without a voice.
            let background = (there.background_lines + 1.0) / (near + 2.0);
            let moved = (background - self.weights.background).abs();
            self.weights.background = background;
            here = self.evaluate(&at);
            converged = step.norm() < REST_M && moved < 1e-4;
            if converged {
                break;
            }
        }
        let gain = here.log_likelihood - near * self.window.background_per_m2.ln();
        Ok(Top {
            at_m: at,
            information: position_block(&here),
            lines: here.effective_lines(),
            gain,
            converged,
        })
    }

    fn evaluate(&mut self, at_m: &Vector3<f64>) -> Evaluation {
        let pose = Isometry3::from_parts(Translation3::from(*at_m), nalgebra::UnitQuaternion::identity());
        self.likelihood.evaluate(&self.window, &pose, &self.weights, &mut self.evaluation);
        self.evaluation.clone()
    }

    /// Whether a top is a point.
    fn judged(&self, top: &Top, lines: &[Line], searched: bool) -> Result<TrackedPoint, Failure> {
        if !(top.lines >= LINES_NEEDED as f64) {
            let background = 100.0 * (1.0 - top.lines / lines.len().max(1) as f64);
            return Err(Failure::Background { effective: top.lines, background, needed: LINES_NEEDED });
        }
        let needed = if searched { SEARCHED_GAIN } else { FOLLOWED_GAIN };
        if !(top.gain >= needed) {
            return Err(Failure::NoEvidence { gain: top.gain, needed });
        }
        if !top.converged {
            return Err(Failure::NotConverged { steps: STEPS });
        }
        let information = top.information * self.noise.information_share;
        let covariance_m2 = information.cholesky().ok_or(Failure::Indefinite)?.inverse();
        let largest = covariance_m2.symmetric_eigenvalues().max().sqrt();
        if !(largest <= self.limits.position_m) {
            return Err(Failure::Uncertain {
                position_mm: 1e3 * largest,
                rotation_deg: 0.0,
                allowed_mm: 1e3 * self.limits.position_m,
                allowed_deg: self.limits.rotation_rad.to_degrees(),
            });
        }
        Ok(TrackedPoint { position_world_m: top.at_m, covariance_m2, lines: top.lines, searched })
    }

    /// Before all points were found in one window, which is which cannot be told.
    fn refuse_unnumbered(&self, found: &mut [Result<TrackedPoint, Failure>]) {
        if self.memory.iter().all(|memory| memory.position_world_m.is_some()) {
            return;
        }
        let (seen, all) = (found.iter().filter(|point| point.is_ok()).count(), found.len());
        if seen < all {
            found.iter_mut().filter(|point| point.is_ok()).for_each(|point| {
                *point = Err(Failure::Unnumbered { found: seen, points: all });
            });
        }
    }

    /// Of two that are followed and came too close, the one that came further is none.
    fn refuse_neighbours(&self, found: &mut [Result<TrackedPoint, Failure>]) {
        for i in 0..found.len() {
            for j in i + 1..found.len() {
                let (Ok(a), Ok(b)) = (&found[i], &found[j]) else { continue };
                let apart_m = (a.position_world_m - b.position_world_m).norm();
                if apart_m < self.least_apart_m() {
                    let weaker = if self.way_m(i, a) > self.way_m(j, b) { i } else { j };
                    found[weaker] = Err(self.too_close([i, j], apart_m));
                }
            }
        }
    }

    /// How far a point is from where it was last, m.
    fn way_m(&self, number: usize, point: &TrackedPoint) -> Option<f64> {
        Some((point.position_world_m - self.memory[number].position_world_m?).norm())
    }

    fn learn(&mut self, lines: &[Line], found: &[Result<TrackedPoint, Failure>]) {
        for (memory, found) in self.memory.iter_mut().zip(found) {
            let Ok(point) = found else {
                memory.unseen = memory.unseen.saturating_add(1);
                continue;
            };
            let share = point.lines / lines.len().max(1) as f64;
            let known = memory.unseen == 0 && !point.searched;
            memory.share = if known { memory.share + FORGETTING * (share - memory.share) } else { share };
            memory.position_world_m = Some(point.position_world_m);
            memory.unseen = 0;
        }
    }

    /// A line belongs to the point that it passes nearest, within three times [`PASSING_M`]; else to none.
    fn roles(&self, lines: &[Line], found: &[Result<TrackedPoint, Failure>]) -> Vec<Role> {
        let one = |line: &Line| {
            if !is_usable(line) {
                return Role::Unused;
            }
            let mut nearest = (3.0 * PASSING_M, Role::Background);
            for (k, point) in found.iter().enumerate() {
                let Ok(point) = point else { continue };
                let distance = distance_m(line, &point.position_world_m);
                if distance < nearest.0 {
                    nearest = (distance, Role::Marker(k as u8));
                }
            }
            nearest.1
        };
        lines.iter().map(one).collect()
    }
}

fn position_block(evaluation: &Evaluation) -> Matrix3<f64> {
    evaluation.information.fixed_view::<3, 3>(0, 0).into_owned()
}

/// The Newton step, damped until the matrix is positive definite, and cut to what a quadratic form can be trusted for.
fn damped(
    information: &Matrix3<f64>,
    gradient: &Vector3<f64>,
    floor: f64,
    damping: &mut f64,
) -> Option<Vector3<f64>> {
    while *damping < 1e6 {
        if let Some(root) = (information + Matrix3::identity() * (*damping * floor)).cholesky() {
            let step = root.solve(gradient);
            let long = step.norm() / LONGEST_M;
            return long.is_finite().then(|| step / long.max(1.0));
        }
        *damping = f64::max(4.0 * *damping, 0.1);
    }
    None
}

/// By x, then y, then z.
fn by_place(a: &Vector3<f64>, b: &Vector3<f64>) -> Ordering {
    a.iter().zip(b.iter()).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
}
