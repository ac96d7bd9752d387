//! A person of the cohort, and a capsule's passage through one segment of theirs.

use crate::ReproduceError;
use crate::context::Context;
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_anatomy::tract_file::{self, TractOptions};
use lumenav_core::config::quantity::{Finite, NonNegative};
use lumenav_core::{CapsuleBody, Node, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig, EngineState};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

/// The shipped guts, of persons in turn.
const SIZES: [&str; 3] = ["small-woman", "average-man", "large-man"];
/// Where in its segment a capsule starts, m: its own length and no more behind the entrance.
const START_M: f64 = 0.02;

/// A PillCam: 11 x 26 mm, 3.3 g.
pub(super) const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };

/// How a person is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Posture {
    Upright,
    Supine,
}

impl Posture {
    /// Gravity in the torso frame, m/s².
    fn gravity_m_s2(self) -> [Finite; 3] {
        match self {
            Self::Upright => [0.0, 0.0, -9.81].map(Finite),
            Self::Supine => [0.0, -9.81, 0.0].map(Finite),
        }
    }
}

/// The guts of the cohort.
pub(super) struct Cohort {
    tracts: Vec<Arc<Tract>>,
    seed: u64,
}

impl Cohort {
    pub(super) fn open(context: &Context<'_>) -> Result<Self, ReproduceError> {
        let read = |size: &&str| -> Result<Arc<Tract>, ReproduceError> {
            let path = context.models.root().join("tracts").join(format!("whole-gut-{size}.toml"));
            let all = TractOptions { segments: Vec::new(), length_scale: 1.0, radius_scale: 1.0 };
            Ok(Arc::new(tract_file::load(&Node::open(&path)?, &all)?.0))
        };
        let tracts = SIZES.iter().map(read).collect::<Result<_, _>>()?;
        // A reproduction is never run without a seed.
        Ok(Self { tracts, seed: context.seeds.first().copied().unwrap_or(1) })
    }

    /// Every person is a trial of the seed, with one of the shipped guts.
    pub(super) fn engine(
        &self,
        person: usize,
        posture: Posture,
        start: SegmentKey,
    ) -> Result<Engine, ReproduceError> {
        let tract = &self.tracts[person % self.tracts.len()];
        let streams = RandomStreams::new(self.seed, person as u64, "motility");
        let failed = |what: &dyn std::fmt::Display| ReproduceError::of_part("gut")(what);
        let motility =
            Motility::new(&MotilityConfig::default(), tract, &streams).map_err(|error| failed(&error))?;
        let [start_m, _] = span_m(tract, start, start);
        let config = EngineConfig {
            start_arc_length_m: NonNegative(start_m + START_M),
            gravity_torso_m_s2: posture.gravity_m_s2(),
            // It is on its way, not put to rest.
            settle_s: NonNegative(0.0),
            ..EngineConfig::default()
        };
        Engine::new(config, tract.clone(), motility, CAPSULE).map_err(|error| failed(&error))
    }
}

/// From the start of the one to the end of the other segment, m.
pub(super) fn span_m(tract: &Tract, first: SegmentKey, last: SegmentKey) -> [f64; 2] {
    let of = |key| tract.segments.iter().find(|segment| segment.key == key);
    // The shipped guts have every segment.
    [
        of(first).map_or(0.0, |segment| segment.start_m),
        of(last).map_or(tract.length_m(), |segment| segment.end_m),
    ]
}

/// A capsule at one instant of its passage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) arc_length_m: f64,
    pub(super) position_m: Point3<f64>,
    pub(super) axis: Vector3<f64>,
}

impl Sample {
    fn of(state: &EngineState) -> Self {
        Self {
            arc_length_m: state.arc_length_m,
            position_m: Point3::from(state.world_from_capsule.translation.vector),
            axis: state.world_from_capsule.rotation * Vector3::x(),
        }
    }
}

/// A passage from a segment's entrance to the end of a segment.
#[derive(Clone, Debug)]
pub(super) struct Passage {
    /// Time to the first crossing of the end, s; `None`: not within the limit.
    pub(super) duration_s: Option<f64>,
    /// The capsule at equal intervals.
    pub(super) samples: Vec<Sample>,
}

/// Follows a capsule until its centre first passes `end_m` or leaves the tract, or for `limit_s`.
pub(super) fn pass(engine: &mut Engine, end_m: f64, limit_s: f64, every_s: f64) -> Passage {
    let mut samples = vec![Sample::of(&engine.state())];
    let mut time_s = 0.0;
    while time_s < limit_s {
        time_s += every_s;
        engine.advance_to(SimTime::from_seconds(time_s));
        let state = engine.state();
        samples.push(Sample::of(&state));
        if state.left || state.arc_length_m >= end_m {
            return Passage { duration_s: Some(time_s), samples };
        }
    }
    Passage { duration_s: None, samples }
}

/// Small bowels of `persons`, one sample a second.
pub(super) fn small_bowels(
    context: &Context<'_>,
    cohort: &Cohort,
    persons: usize,
) -> Result<Vec<Passage>, ReproduceError> {
    const LIMIT_S: f64 = 16.0 * 3600.0;
    context.jobs("small bowel", persons, |person| {
        let mut engine = cohort.engine(person, Posture::Upright, SegmentKey::Duodenum)?;
        let [_, end_m] = span_m(engine.tract(), SegmentKey::Duodenum, SegmentKey::TerminalIleum);
        Ok(pass(&mut engine, end_m, LIMIT_S, 1.0))
    })
}

/// Stomachs of `persons`, one sample a second.
pub(super) fn stomachs(
    context: &Context<'_>,
    cohort: &Cohort,
    persons: usize,
) -> Result<Vec<Passage>, ReproduceError> {
    const LIMIT_S: f64 = 12.0 * 3600.0;
    context.jobs("stomach", persons, |person| {
        let mut engine = cohort.engine(person, Posture::Upright, SegmentKey::Stomach)?;
        let [_, end_m] = span_m(engine.tract(), SegmentKey::Stomach, SegmentKey::Stomach);
        Ok(pass(&mut engine, end_m, LIMIT_S, 1.0))
    })
}
