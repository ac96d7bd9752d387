//! A person of the cohort, and a capsule's passage through one segment of theirs.

use super::stalls::StallAudit;
use crate::ReproduceError;
use crate::context::Context;
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_anatomy::tract_file::{self, TractOptions};
use lumenav_core::config::quantity::{Finite, NonNegative};
use lumenav_core::{CapsuleBody, Node, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig};
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

/// A way through the gut that is followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    /// What tables call it.
    pub(super) name: &'static str,
    pub(super) posture: Posture,
    /// The segment at whose entrance it starts.
    pub(super) first: SegmentKey,
    /// The segment at whose end it ends; `None`: the way out.
    pub(super) last: Option<SegmentKey>,
    /// Longest passage that is waited for, s.
    pub(super) limit_s: f64,
    /// The capsule is looked at so often, s.
    pub(super) every_s: f64,
}

pub(super) const STOMACH: Leg = Leg {
    name: "stomach",
    posture: Posture::Upright,
    first: SegmentKey::Stomach,
    last: Some(SegmentKey::Stomach),
    limit_s: 12.0 * 3600.0,
    every_s: 1.0,
};

pub(super) const SMALL_BOWEL: Leg = Leg {
    name: "small bowel",
    posture: Posture::Upright,
    first: SegmentKey::Duodenum,
    last: Some(SegmentKey::TerminalIleum),
    limit_s: 16.0 * 3600.0,
    every_s: 1.0,
};

/// The guts of the cohort.
pub(super) struct Cohort {
    tracts: Vec<Arc<Tract>>,
    seeds: Vec<u64>,
}

impl Cohort {
    pub(super) fn open(context: &Context<'_>) -> Result<Self, ReproduceError> {
        let read = |size: &&str| -> Result<Arc<Tract>, ReproduceError> {
            let path = context.models.root().join("tracts").join(format!("whole-gut-{size}.toml"));
            let all = TractOptions { segments: Vec::new(), length_scale: 1.0, radius_scale: 1.0 };
            Ok(Arc::new(tract_file::load(&Node::open(&path)?, &all)?.0))
        };
        let tracts = SIZES.iter().map(read).collect::<Result<_, _>>()?;
        Ok(Self { tracts, seeds: context.seeds.clone() })
    }

    /// The gut of a person: the shipped ones in turn.
    pub(super) fn tract(&self, person: usize) -> &Arc<Tract> {
        &self.tracts[person % self.tracts.len()]
    }

    /// The motility of a person: each a trial of a seed, the seeds in turn for each three persons.
    pub(super) fn motility(&self, person: usize) -> Result<Motility, ReproduceError> {
        let seed = self.seeds[person / self.tracts.len() % self.seeds.len()];
        let streams = RandomStreams::new(seed, person as u64, "motility");
        Motility::new(&MotilityConfig::default(), self.tract(person), &streams)
            .map_err(ReproduceError::of_part("motility"))
    }

    fn engine(&self, person: usize, leg: &Leg) -> Result<Engine, ReproduceError> {
        let tract = self.tract(person);
        let config = EngineConfig {
            start_arc_length_m: NonNegative(start_m(tract, leg.first) + START_M),
            gravity_torso_m_s2: leg.posture.gravity_m_s2(),
            // It is on its way, not put to rest.
            settle_s: NonNegative(0.0),
            ..EngineConfig::default()
        };
        Engine::new(config, tract.clone(), self.motility(person)?, CAPSULE)
            .map_err(ReproduceError::of_part("engine"))
    }

    /// What `told` makes of the passages of `persons` along a leg.
    pub(super) fn pass<T: Send>(
        &self,
        context: &Context<'_>,
        leg: &Leg,
        persons: usize,
        told: impl Fn(usize, &Passage) -> T + Sync,
    ) -> Result<Vec<T>, ReproduceError> {
        context.jobs(leg.name, persons, |person| {
            let end_m = leg.last.map_or(f64::INFINITY, |last| end_m(self.tract(person), last));
            let passage = pass(&mut self.engine(person, leg)?, end_m, leg);
            Ok(told(person, &passage))
        })
    }
}

/// Where a segment starts, m. The shipped guts have every one.
fn start_m(tract: &Tract, key: SegmentKey) -> f64 {
    tract.segments.iter().find(|segment| segment.key == key).map_or(0.0, |segment| segment.start_m)
}

/// Where a segment ends, m.
pub(super) fn end_m(tract: &Tract, key: SegmentKey) -> f64 {
    let found = tract.segments.iter().find(|segment| segment.key == key);
    found.map_or(tract.length_m(), |segment| segment.end_m)
}

/// A capsule at one instant of its passage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) arc_length_m: f64,
    pub(super) position_m: Point3<f64>,
    pub(super) axis: Vector3<f64>,
    /// Offset from the centre line beyond what the resting lumen leaves free, m; NaN where the state is not finite.
    pub(super) excess_m: f64,
}

impl Sample {
    fn of(engine: &Engine) -> Self {
        let state = engine.state();
        let resting_m = engine.tract().radius.radius_m(state.arc_length_m);
        Self {
            excess_m: state.offset_m - (resting_m - CAPSULE.radius_m).max(0.0),
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
    /// Its stalls.
    pub(super) stalls: StallAudit,
}

/// Follows a capsule until its centre first passes `end_m` or leaves the tract, or for as long as the leg waits.
fn pass(engine: &mut Engine, end_m: f64, leg: &Leg) -> Passage {
    let mut samples = vec![Sample::of(engine)];
    let mut stalls = StallAudit::new(&EngineConfig::default(), engine.state().arc_length_m);
    let mut time_s = 0.0;
    while time_s < leg.limit_s {
        time_s += leg.every_s;
        engine.advance_to(SimTime::from_seconds(time_s));
        samples.push(Sample::of(engine));
        let state = engine.state();
        if state.left || state.arc_length_m >= end_m {
            return Passage { duration_s: Some(time_s), samples, stalls };
        }
        stalls.look(time_s, state.arc_length_m, engine.events());
    }
    Passage { duration_s: None, samples, stalls }
}
