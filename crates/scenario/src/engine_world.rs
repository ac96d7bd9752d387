//! The engine as a world: truth of a capsule in a moving tract.

#![expect(clippy::disallowed_types, reason = "world side: the engine is where truth comes from")]

use crate::diverticula;
use crate::engine::{ENGINE_SOURCES, Engine, EngineConfig, EngineError, EventKind, Obstacle};
use crate::error::ScenarioError;
use crate::file::{ScenarioFile, TractTable};
use crate::loose::{self, LooseTable};
use crate::obstacles;
use crate::patient::{Patient, calibrated_frame, frame_of};
use crate::wave_notes::WaveWatch;
use crate::world::{Checkpoint, TruthHistory, World, WorldNote};
use lumenav_anatomy::lumen::Lumen;
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::motility_sources::MOTILITY_SOURCES;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_anatomy::tract_file::{self, TractOptions};
use lumenav_anatomy::tube_mesh;
use lumenav_core::config::quantity::{Finite, NonNegative};
use lumenav_core::{CapsuleTruth, ConfigError, Primitive, RandomStreams, SimTime, TruthView};
use nalgebra::Isometry3;
use std::ops::Range;
use std::sync::Arc;

/// Name under which motility draws its random numbers.
pub const COMPONENT: &str = "motility";

/// The key that a posture replaces.
const GRAVITY_KEY: &str = "gravity_torso_m_s2";

/// Spacing of the rings of the drawn lumen, m.
const DRAWN_RING_M: f64 = 0.004;
/// Corners of a ring of the drawn lumen.
const DRAWN_SIDES: usize = 24;
/// A place whose radius is below this share of its resting radius is drawn as contracted.
const CONTRACTED: f64 = 0.75;

/// A capsule in a tract, stepped by the engine.
pub struct EngineWorld {
    engine: Engine,
    /// What stands in the tract, in the order of the file.
    obstacles: Vec<Vec<Obstacle>>,
    /// What is loose in it, in the order of the file; the links of a tether follow.
    loose: Vec<LooseTable>,
    has_tether: bool,
    /// Pose, velocity and angular rate in the gut's frame: the patient's part is added at the very instant that is asked for.
    history: TruthHistory,
    step_ns: i64,
    notes: Vec<WorldNote>,
    /// What will happen at known times, the next one last.
    to_tell: Vec<WorldNote>,
    waves: WaveWatch,
}

/// Reads the tract that `[tract]` names.
///
/// # Errors
/// [`ConfigError`] with file, line and key.
pub fn read_tract(file: &ScenarioFile, table: &TractTable) -> Result<(Arc<Tract>, Vec<String>), ConfigError> {
    let node = file.node.child_or_empty("tract");
    let mut segments = Vec::new();
    for name in &table.segments {
        let key = SegmentKey::from_name(name).ok_or_else(|| {
            let message = format!("unknown segment `{name}`; allowed: {}", SegmentKey::allowed());
            node.error_at("segments", &message)
        })?;
        segments.push(key);
    }
    let options =
        TractOptions { segments, length_scale: table.length_scale.0, radius_scale: table.radius_scale.0 };
    let model = file.models.open("tracts", &table.model, &node, "model")?;
    let (tract, report) = tract_file::load(&model, &options)?;
    Ok((Arc::new(tract), report.warnings))
}

impl EngineWorld {
    /// The world of a scenario with a `[tract]`.
    ///
    /// # Errors
    /// [`ScenarioError`] with file, line and key.
    pub fn new(
        file: &ScenarioFile,
        table: &TractTable,
        patient: Option<Arc<Patient>>,
        streams: &RandomStreams,
    ) -> Result<(Self, Arc<Tract>), ScenarioError> {
        let (tract, warnings) = read_tract(file, table)?;
        let motility_node = file.node.child_or_empty("motility");
        let motility: MotilityConfig = motility_node.parse_sourced(&MOTILITY_SOURCES)?;
        let engine_node = file.node.child_or_empty("engine");
        let mut config: EngineConfig = engine_node.parse_sourced(&ENGINE_SOURCES)?;
        let capsule_node = file.node.child_or_empty("capsule");
        let start_m = file.capsule.start_arc_length_mm.0 * 1e-3;
        if start_m > tract.length_m() {
            let message = format!(
                "{:.0} mm is beyond the tract's end; allowed: 0 to {:.0}",
                1e3 * start_m,
                1e3 * tract.length_m()
            );
            return Err(capsule_node.error_at("start_arc_length_mm", &message).into());
        }
        config.start_arc_length_m = NonNegative(start_m);
        config.start_roll_rad = Finite(file.capsule.start_roll_deg.0.to_radians());
        if patient.is_some() && engine_node.keys().iter().any(|key| key == GRAVITY_KEY) {
            let message = "with a [patient] the posture says where gravity points; leave this out";
            return Err(engine_node.error_at(GRAVITY_KEY, message).into());
        }
        let step_ns = (1e9 / f64::from(config.step_rate_hz)).round() as i64;
        let told = motility.announcements();
        let motility =
            Motility::new(&motility, &tract, streams).map_err(|error| error.at_motility(&motility_node))?;
        let mut engine =
            Engine::new(config, tract.clone(), motility, file.body).map_err(|error| match &error {
                EngineError::OutOfRange { name, .. } => engine_node.error_at(name, &error.to_string()),
                // The capsule's own file is at fault, not the scenario's.
                EngineError::CapsuleShape { .. } => {
                    file.capsule_model.child_or_empty("capsule").error_at("length_mm", &error.to_string())
                }
                _ => engine_node.error(&error.to_string()),
            })?;
        if let Some(patient) = patient {
            engine = engine.within(patient);
        }
        let tract_node = file.node.child_or_empty("tract");
        let obstacles = obstacles::place_all(&table.obstacle, &tract, &tract_node)?;
        for part in obstacles.iter().flatten() {
            engine.insert_obstacle(part);
        }
        for diverticulum in diverticula::place_all(&table.diverticulum, &tract, &tract_node)? {
            engine.insert_diverticulum(diverticulum);
        }
        loose::insert_all(&mut engine, &table.loose, table.tether.as_ref(), &file.body, &tract_node)?;
        engine.settle().map_err(|error| capsule_node.error_at("start_arc_length_mm", &error.to_string()))?;
        let waves = WaveWatch::new(engine.lumen().motility());
        let history = TruthHistory::default();
        let warned = warnings.into_iter().map(|text| WorldNote {
            at: SimTime::ZERO,
            text: format!("tract: {text}"),
            standing: true,
        });
        let dated = told.into_iter().map(|(at_s, text)| (at_s, format!("motility: {text}")));
        let dated = dated.chain(engine.patient().into_iter().flat_map(|patient| patient.notes()));
        let mut to_tell: Vec<WorldNote> = dated
            .map(|(at_s, text)| WorldNote { at: SimTime::from_seconds(at_s), text, standing: false })
            .collect();
        // The last is told first.
        to_tell.sort_by_key(|note| std::cmp::Reverse(note.at));
        let (loose, has_tether) = (table.loose.clone(), table.tether.is_some());
        let notes = warned.collect();
        let mut world =
            Self { engine, obstacles, loose, has_tether, history, step_ns, notes, to_tell, waves };
        world.remember();
        Ok((world, tract))
    }

    fn patient(&self) -> Option<&Patient> {
        self.engine.patient().map(|patient| &**patient)
    }

    /// The engine's state, in the gut's frame.
    fn now(&self) -> CapsuleTruth {
        let state = self.engine.state_in_gut();
        CapsuleTruth {
            at: state.at,
            world_from_capsule: state.world_from_capsule,
            velocity_world_m_s: state.velocity_world_m_s,
            angular_rate_capsule_rad_s: state.angular_rate_capsule_rad_s,
            specific_force_capsule_m_s2: state.specific_force_capsule_m_s2,
            arc_length_m: Some(state.arc_length_m),
            // What has left is in no segment.
            segment: (!state.left).then(|| self.engine.tract().segment_name_at(state.arc_length_m)),
            wall_force_n: Some(state.wall_force_n),
        }
    }

    /// Adds the engine's state to the history, and its events to the notes.
    fn remember(&mut self) {
        let state = self.engine.state_in_gut();
        self.history.push(self.now());
        while let Some(note) = self.to_tell.pop_if(|note| note.at <= state.at) {
            self.notes.push(note);
        }
        for event in self.engine.events() {
            let mm = 1e3 * event.arc_length_m;
            let text = match event.kind {
                // Contact comes and goes many times a minute in a wide colon: not worth a line each.
                EventKind::ContactLost => continue,
                EventKind::SegmentEntered(key) => format!("entered {key} at {mm:.0} mm"),
                EventKind::LandmarkPassed { name, aboral } => {
                    let way = if aboral { "aborally" } else { "orally" };
                    format!("passed {name} {way} at {mm:.0} mm")
                }
                EventKind::Stalled => format!("stalled at {mm:.0} mm"),
                EventKind::Retained => format!("retained at {mm:.0} mm"),
                EventKind::TetherCrossed { from_m } => format!(
                    "the tether takes a short cut between two loops at {:.0} mm: from here on it is shorter than the bowel it runs through",
                    1e3 * from_m
                ),
                EventKind::Left => format!("left the tract at {mm:.0} mm; its truth stays there"),
            };
            self.notes.push(WorldNote { at: event.at, text, standing: false });
        }
        if !state.left {
            self.waves.look(state.at, state.arc_length_m, &mut self.notes);
        }
    }
}

impl TruthView for EngineWorld {
    fn interval(&self) -> Range<SimTime> {
        self.history.interval()
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        // The constructor remembers the start, so the history is never empty.
        let carried = self.history.at(at).unwrap_or_else(|| unreachable!("the history holds the start"));
        let Some(patient) = self.patient() else { return carried };
        // Outside the interval the nearest end is given, the patient's part with it.
        let gut = patient.gut(carried.at.seconds());
        let pose = &carried.world_from_capsule;
        CapsuleTruth {
            world_from_capsule: gut.world_from_frame * pose,
            velocity_world_m_s: gut.velocity_world(&pose.translation.vector, &carried.velocity_world_m_s),
            angular_rate_capsule_rad_s: carried.angular_rate_capsule_rad_s
                + pose.rotation.inverse() * gut.rate_frame_rad_s,
            ..carried
        }
    }

    fn frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        frame_of(self.patient(), name, at.seconds())
    }

    fn told_frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        self.frame(calibrated_frame(name), at)
    }
}

impl World for EngineWorld {
    fn advance_to(&mut self, to: SimTime) -> Result<(), ScenarioError> {
        while self.history.newest().is_none_or(|newest| newest < to) {
            let next = self.engine.time() + self.step_ns;
            self.engine.advance_to(next);
            if self.history.newest() == Some(self.engine.time()) {
                // The engine rounds to whole steps: take the one behind `next`.
                self.engine.step();
            }
            self.remember();
            let state = self.engine.state_in_gut();
            if !self.engine.is_sound() {
                let what =
                    "the position of the capsule, or of what is loose beside it, is not finite".to_owned();
                return Err(ScenarioError::Engine { at_s: state.at.seconds(), what });
            }
        }
        Ok(())
    }

    fn truth(&self) -> &dyn TruthView {
        self
    }

    fn forget_before(&mut self, at: SimTime) {
        self.history.forget_before(at);
    }

    fn take_notes(&mut self) -> Vec<WorldNote> {
        std::mem::take(&mut self.notes)
    }

    fn checkpoint(&self) -> Option<Checkpoint> {
        // Rapier's contacts remember what they were, and a snapshot does not hold them.
        if !self.obstacles.is_empty() {
            return None;
        }
        // The engine's own bytes end where the stages of the waves begin.
        let snapshot = self.engine.snapshot();
        let mut bytes = (snapshot.len() as u64).to_le_bytes().to_vec();
        bytes.extend_from_slice(&snapshot);
        bytes.extend(self.waves.stages());
        Some(Checkpoint { world: self.engine.fingerprint(), bytes })
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), ScenarioError> {
        let damaged = || ScenarioError::Checkpoint { why: "cut short, or damaged" };
        let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(damaged)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| damaged())?;
        let (snapshot, stages) = rest.split_at_checked(length).ok_or_else(damaged)?;
        let before = self.waves.stages();
        self.waves.recall(stages).ok_or_else(damaged)?;
        if let Err(error) = self.engine.restore(snapshot) {
            // They were its own.
            let _ = self.waves.recall(&before);
            let why = if let EngineError::Snapshot { reason } = error { reason } else { "refused" };
            return Err(ScenarioError::Checkpoint { why });
        }
        let now = self.now();
        self.to_tell.retain(|note| note.at > now.at);
        self.notes.clear();
        self.history = TruthHistory::default();
        self.history.push(now);
        Ok(())
    }

    fn static_scene(&self, out: &mut Vec<Primitive>) {
        draw_lumen(self.engine.lumen(), out);
        obstacles::draw(&self.obstacles, out);
    }

    /// Rings where the wall is contracted now.
    fn moving_scene(&self, out: &mut Vec<Primitive>) {
        let tract = self.engine.tract();
        let time_s = self.engine.time().seconds();
        let rings = (tract.length_m() / DRAWN_RING_M) as usize;
        let mut strips = Vec::new();
        for i in 0..=rings {
            let s = i as f64 * DRAWN_RING_M;
            let sample = self.engine.lumen().radius(s, 0.0, time_s);
            if sample.radius_m < CONTRACTED * self.engine.lumen().resting_radius_m(s, 0.0) {
                let station = tract.station(s);
                let corner = |k: usize| {
                    let angle = std::f64::consts::TAU * k as f64 / DRAWN_SIDES as f64;
                    let radius = self.engine.lumen().radius(s, angle, time_s).radius_m;
                    let p = station.position_m
                        + (station.normal * angle.cos() + station.binormal * angle.sin()) * radius;
                    [p.x as f32, p.y as f32, p.z as f32]
                };
                strips.push((0..=DRAWN_SIDES).map(corner).collect());
            }
        }
        out.push(Primitive::Lines {
            path: "tract/contraction".into(),
            strips_world_m: strips,
            rgba: vec![0xCC33_11FF],
        });
        loose::draw(&self.engine, &self.loose, self.has_tether, out);
        if let Some(patient) = self.patient() {
            let gut = patient.gut(time_s);
            out.push(Primitive::Placement { path: "tract".into(), world_from_path: gut.world_from_frame });
        }
    }
}

/// Colours of the segments, in turn (Tol's light scheme: told apart by colour-blind readers).
const SEGMENT_RGBA: [u32; 6] = [0xEE88_6640, 0x77AA_DD40, 0xEEDD_8840, 0xFFAA_BB40, 0x99DD_FF40, 0x44BB_9940];

/// Resting lumen, with its folds, and centre line.
fn draw_lumen(lumen: &Lumen, out: &mut Vec<Primitive>) {
    let tract = lumen.tract();
    let rings = (tract.length_m() / DRAWN_RING_M).ceil() as usize + 1;
    let mesh = tube_mesh(tract, rings, DRAWN_SIDES, |s, angle| lumen.resting_radius_m(s, angle));
    let colour = |s: &f32| SEGMENT_RGBA[tract.segment_index_at(f64::from(*s)) % SEGMENT_RGBA.len()];
    out.push(Primitive::Mesh {
        path: "tract/lumen".into(),
        rgba: mesh.arc_length_m.iter().map(colour).collect(),
        vertices_world_m: mesh.vertices_m,
        triangles: mesh.triangles,
    });
    let line = (0..=rings).map(|i| {
        let p = tract.station(tract.length_m() * i as f64 / rings as f64).position_m;
        [p.x as f32, p.y as f32, p.z as f32]
    });
    out.push(Primitive::Lines {
        path: "tract/centre_line".into(),
        strips_world_m: vec![line.collect()],
        rgba: vec![0x8888_88FF],
    });
}
