//! The simulated scanner: truth in, lines of a window out.
//!
//! Window n is `[due(n), due(n) + window_ms]` and is handed over at its end. The capsule moves while it lasts: decays are placed by
//! its pose at their own instants, taken from the truth at eleven instants and at constant twist between them. Misplacements are
//! drawn once, from the stream `placement`; the decays of window n come from streams of its number, so that a window that is lost
//! (stream `(loss, n)`) shifts no other.
//!
//! The world is the patient's. Where a bed moves the patient through the scanner ([`Sensor::command`]), decays and body are simulated in
//! the scanner's frame, and the lines are handed over in the patient's, each moved back by where the bed's encoder says the scanner
//! stood at its instant: the estimates are compensated before they are made. Within a window the body stands where it is in the middle.
//!
//! A patient who moves in the room (frame `torso`) carries the body along; one who turns is refused where there is a body, which the
//! simulation shifts and does not turn.

#![expect(clippy::disallowed_types, reason = "world side: a sensor observes the truth")]

use crate::config::{Installed, RealityTable, sources};
use crate::line::Line;
use crate::markers::MarkerSet;
use crate::payload;
use crate::rail::Rail;
use crate::scanner::Scanner;
use crate::simulation::{LabelledLine, Mode, Origin, Settings, Simulator, SourceMarker, TableStore};
use lumenav_core::frame::ColumnKind;
use lumenav_core::pose::interpolate;
use lumenav_core::time::nanoseconds;
use lumenav_core::{
    Column, ColumnSpec, Frame, ModalityError, Name, Node, Observation, Primitive, RandomStreams, Reading,
    Rows, Schedule, Schema, Sensor, Setup, SimTime, TruthView,
};
use nalgebra::{Isometry3, Translation3, Vector3, Vector6};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Instants of a window at which the truth is asked: a path that bends within 5 ms is no capsule's.
const NODES: usize = 11;

/// A simulated scanner with a capsule's markers in it.
pub struct PetSensor {
    name: Name,
    installed: Installed,
    reality: RealityTable,
    true_markers: Vec<SourceMarker>,
    schedule: Schedule,
    window_ns: i64,
    tables: TableStore,
    simulator: Option<Simulator>,
    lines: Vec<LabelledLine>,
    sequence: u64,
    /// Where a bed has put it; `None` where there is no bed.
    rail: Option<Rail>,
    /// The end of the last window.
    seen: SimTime,
}

impl PetSensor {
    /// Builds the sensor; misplacements are drawn at the first window.
    ///
    /// # Errors
    /// [`ModalityError::Config`] for markers without an isotope's file, and misplacements of markers that there are not.
    pub fn new(
        setup: &Setup,
        installed: Installed,
        reality: RealityTable,
        node: &Node,
        schedule: Schedule,
    ) -> Result<Self, ModalityError> {
        let markers = MarkerSet::from_capsule(&setup.capsule_model, &setup.sensor, 1)?;
        for (key, given) in [
            ("marker_misplacement_mm", reality.marker_misplacement_mm.len()),
            ("marker_activity_factor", reality.marker_activity_factor.len()),
        ] {
            if given > markers.len() {
                let message = format!("{given} entries; the capsule has {} markers", markers.len());
                return Err(node.error_at(key, &message).into());
            }
        }
        let true_markers = sources(&markers, setup)?;
        Ok(Self {
            name: setup.sensor.clone(),
            window_ns: window_ns(&installed, &schedule),
            installed,
            reality,
            true_markers,
            schedule,
            tables: TableStore::default(),
            simulator: None,
            lines: Vec::new(),
            sequence: 0,
            rail: None,
            seen: SimTime::ZERO,
        })
    }

    /// With tables that other scanners of the same set-up have made or will use.
    #[must_use]
    pub fn sharing(self, tables: TableStore) -> Self {
        Self { tables, ..self }
    }

    /// The markers where and as active as they truly are.
    fn misplace(&self, random: &RandomStreams) -> Vec<SourceMarker> {
        let mut stream = random.stream("placement", 0);
        let sigma_m = self.reality.marker_placement_sigma_mm.0 * 1e-3;
        let mut markers = self.true_markers.clone();
        for (i, marker) in markers.iter_mut().enumerate() {
            let drawn: [f64; 3] = std::array::from_fn(|_| stream.sample(StandardNormal));
            let told = self.reality.marker_misplacement_mm.get(i).map_or([0.0; 3], |m| m.map(|v| v.0 * 1e-3));
            marker.position_capsule_m += Vector3::from(drawn) * sigma_m + Vector3::from(told);
            marker.activity_bq *= self.reality.marker_activity_factor.get(i).map_or(1.0, |f| f.0);
        }
        markers
    }

    /// What the bed's encoder tells.
    fn known_poses(&self, at_s: f64) -> BTreeMap<String, Isometry3<f64>> {
        let z_m = self.rail.as_ref().map(|rail| rail.z_m(at_s));
        z_m.map(|z_m| (payload::SCANNER.to_owned(), Isometry3::translation(0.0, 0.0, z_m)))
            .into_iter()
            .collect()
    }

    /// Where the patient has carried the body, m; `None` without a body, or where no patient moves.
    fn torso_m(&self, truth: &dyn TruthView, at: SimTime) -> Result<Option<Vector3<f64>>, ModalityError> {
        let unsupported = |what| Err(ModalityError::Unsupported { kind: "pet", what });
        let torso = truth.frame("torso", at).filter(|_| self.installed.phantom.is_some());
        let Some(torso) = torso else { return Ok(None) };
        if torso.rotation.angle() > 1e-9 {
            return unsupported(
                "simulates no body that turns; allowed with a `phantom`: a [patient] who lies supine, without `posture` events",
            );
        }
        let moved_m = torso.translation.vector;
        if moved_m != Vector3::zeros() && self.reality.mode == Mode::Tabulated {
            return unsupported(
                "carries no body along in mode `tabulated`, whose tables hold one place of it; allowed: `analog`, `forced`",
            );
        }
        Ok(Some(moved_m))
    }

    fn simulator(&mut self, random: &RandomStreams) -> Result<&mut Simulator, ModalityError> {
        if self.simulator.is_none() {
            let settings = Settings {
                mode: self.reality.mode,
                end_points: self.installed.table.end_points,
                acollinearity_fwhm_deg: self.reality.acollinearity_fwhm_deg.0,
            };
            let built = Simulator::sharing(
                &self.tables,
                self.installed.scanner.clone(),
                self.installed.scintillator.clone(),
                self.installed.phantom.clone(),
                self.misplace(random),
                settings,
            );
            self.simulator = Some(built);
        }
        // Filled in the lines above.
        self.simulator.as_mut().ok_or(ModalityError::Snapshot)
    }
}

/// Length of a window, ns.
pub(crate) fn window_ns(installed: &Installed, schedule: &Schedule) -> i64 {
    let period_s = 1.0 / schedule.rate_hz.0;
    nanoseconds(installed.table.window_ms.map_or(period_s, |ms| ms.0 * 1e-3)).max(1)
}

/// The path of the capsule through a window.
struct Path {
    start_s: f64,
    step_s: f64,
    poses: Vec<Isometry3<f64>>,
}

impl Path {
    fn of(truth: &dyn TruthView, start: SimTime, length_ns: i64) -> Self {
        let poses = (0..NODES)
            .map(|k| truth.capsule(start + length_ns * k as i64 / (NODES as i64 - 1)).world_from_capsule)
            .collect();
        Self { start_s: start.seconds(), step_s: length_ns as f64 * 1e-9 / (NODES - 1) as f64, poses }
    }

    fn at(&self, t_s: f64) -> Isometry3<f64> {
        let steps = ((t_s - self.start_s) / self.step_s).clamp(0.0, (NODES - 1) as f64);
        let first = (steps as usize).min(NODES - 2);
        interpolate(&self.poses[first], &self.poses[first + 1], steps - first as f64)
    }
}

impl Sensor for PetSensor {
    fn next_due(&self) -> SimTime {
        self.schedule.due(self.sequence) + self.window_ns
    }

    fn skip_to(&mut self, at: SimTime) {
        self.sequence = self.schedule.first_from(at);
    }

    fn look_back_ns(&self) -> i64 {
        self.window_ns
    }

    fn observe(
        &mut self,
        truth: &dyn TruthView,
        at: SimTime,
        random: &RandomStreams,
    ) -> Result<Option<Observation>, ModalityError> {
        let sequence = self.sequence;
        self.sequence += 1;
        let start = at + -self.window_ns;
        let path = Path::of(truth, start, self.window_ns);
        let (start_s, length_s) = (start.seconds(), self.window_ns as f64 * 1e-9);
        let mut lines = std::mem::take(&mut self.lines);
        lines.clear();
        let rail = self.rail.take();
        let scanner_z_m = |t_s: f64| rail.as_ref().map_or(0.0, |rail| rail.z_m(t_s));
        let motion = |t_s: f64| Translation3::new(0.0, 0.0, -scanner_z_m(t_s)) * path.at(t_s);
        let torso_m = self.torso_m(truth, start + self.window_ns / 2)?;
        let simulator = self.simulator(random)?;
        if rail.is_some() || torso_m.is_some() {
            let scanner_m = Vector3::new(0.0, 0.0, scanner_z_m(start_s + 0.5 * length_s));
            simulator.move_body(torso_m.unwrap_or_default() - scanner_m);
        }
        simulator.window(&motion, start_s, length_s, random, sequence, &mut lines);
        for line in &mut lines {
            let z_m = scanner_z_m(line.line.t_s);
            line.line.ends_world_m.iter_mut().for_each(|end| end.z += z_m);
        }
        self.lines = lines;
        self.rail = rail;
        self.seen = at;
        let lost = self.schedule.loss.0 > 0.0
            && random.stream("loss", sequence).random::<f64>() < self.schedule.loss.0;
        if lost {
            return Ok(None);
        }
        let plain: Vec<Line> = self.lines.iter().map(|l| l.line).collect();
        Ok(Some(Observation {
            reading: Reading {
                sensor: self.name.clone(),
                sequence,
                interval: (start, at),
                arrival: self.schedule.arrival(at),
                known_poses: self.known_poses(start_s + 0.5 * length_s),
                payload: payload::frame(&plain)?,
            },
            labels: Some(labels(&self.lines)?),
        }))
    }

    fn command(&mut self, at: SimTime, twist_world: &Vector6<f64>) -> Result<(), ModalityError> {
        let unsupported = |what| Err(ModalityError::Unsupported { kind: "pet", what });
        if self.reality.mode == Mode::Tabulated {
            return unsupported(
                "moves no scanner in mode `tabulated`, whose tables hold one place of the body",
            );
        }
        if (0..6).any(|axis| axis != 2 && twist_world[axis] != 0.0) || !twist_world[2].is_finite() {
            return unsupported("moves a scanner along z alone");
        }
        let keep_from = self.seen + -self.window_ns;
        self.rail.get_or_insert_with(Rail::resting).set(at, twist_world[2], keep_from);
        Ok(())
    }

    fn encoder(&self, at: SimTime) -> Option<Isometry3<f64>> {
        self.rail.as_ref().map(|rail| Isometry3::translation(0.0, 0.0, rail.z_m(at.seconds())))
    }

    fn scene(&self, out: &mut Vec<Primitive>) {
        let z_m = self.rail.as_ref().map_or(0.0, |rail| rail.z_m(self.seen.seconds()));
        out.push(blocks_mesh(&self.installed.scanner, z_m, &self.lines));
    }
}

/// What only the world knows of the lines: where each comes from (0 true, 1 scattered, 2 prompt, 3 random), how often each photon
/// scattered, which of them is a prompt gamma, and the markers, from 0.
fn labels(lines: &[LabelledLine]) -> Result<Frame, ModalityError> {
    const COLUMNS: [&str; 7] = [
        "origin_index",
        "scatterings_1_count",
        "scatterings_2_count",
        "prompt_1_count",
        "prompt_2_count",
        "marker_1_index",
        "marker_2_index",
    ];
    let columns = COLUMNS.map(|name| ColumnSpec { name: name.to_owned(), kind: ColumnKind::U32 }).to_vec();
    let schema = Arc::new(Schema { name: "line_labels/1".to_owned(), columns, rows: Rows::Events });
    let row = |l: &LabelledLine| {
        let origin = match l.label.origin {
            Origin::True => 0,
            Origin::Scattered => 1,
            Origin::Prompt => 2,
            Origin::Random => 3,
        };
        let [s1, s2] = l.label.scatterings.map(u32::from);
        let [p1, p2] = l.label.prompt.map(u32::from);
        let [m1, m2] = l.label.markers.map(u32::from);
        [origin, s1, s2, p1, p2, m1, m2]
    };
    let rows: Vec<[u32; 7]> = lines.iter().map(row).collect();
    let columns = (0..7).map(|c| Column::U32(rows.iter().map(|r| r[c]).collect())).collect();
    Ok(Frame::new(schema, columns, vec![true; lines.len()])?)
}

/// Colours of a block: silent, and the busiest of the window.
const SILENT_RGB: [f64; 3] = [70.0, 80.0, 95.0];
/// See [`SILENT_RGB`].
const BUSIEST_RGB: [f64; 3] = [255.0, 170.0, 40.0];

/// The blocks of a scanner at a place along z as boxes, each coloured by how often it fired in the window.
fn blocks_mesh(scanner: &Scanner, z_m: f64, lines: &[LabelledLine]) -> Primitive {
    let mut fired = vec![0_u32; scanner.blocks.len()];
    for crystal in lines.iter().flat_map(|l| l.crystals) {
        if let Some(block) = scanner.block_of(crystal) {
            fired[block] += 1;
        }
    }
    let most = f64::from(fired.iter().copied().max().unwrap_or(0).max(1));
    let (half_h, half_z, depth) =
        (scanner.grid.half_width_m(), scanner.grid.half_length_m(), scanner.grid.depth_m);
    let (mut vertices, mut triangles, mut rgba) = (Vec::new(), Vec::new(), Vec::new());
    for (block, count) in fired.iter().enumerate() {
        let share = f64::from(*count) / most;
        let mix = |i: usize| (SILENT_RGB[i] + share * (BUSIEST_RGB[i] - SILENT_RGB[i])) as u32;
        let colour = (mix(0) << 24) | (mix(1) << 16) | (mix(2) << 8) | 0xff;
        let first = vertices.len() as u32;
        for corner in 0..8_u32 {
            let side = |bit: u32, half: f64| if corner & bit == 0 { -half } else { half };
            let deep = if corner & 4 == 0 { 0.0 } else { depth };
            let place = scanner.in_block(block, side(1, half_h), side(2, half_z), deep);
            vertices.push([place.x as f32, place.y as f32, (place.z + z_m) as f32]);
            rgba.push(colour);
        }
        triangles.extend(BOX.map(|t| t.map(|corner| first + corner)));
    }
    Primitive::Mesh { path: "blocks".to_owned(), vertices_world_m: vertices, triangles, rgba }
}

/// Triangles of a box whose corner number has a bit per side.
const BOX: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 7, 5],
    [4, 6, 7],
    [0, 5, 1],
    [0, 4, 5],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 7, 3],
    [1, 5, 7],
];
