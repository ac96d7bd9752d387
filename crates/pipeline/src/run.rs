//! The event loop of one run.
//!
//! One queue in time order holds what will happen: a sensor is due, a reading arrives, the truth is written, a picture is
//! taken. The world is stepped to each event's time, never beyond; truth older than the longest look back is dropped. At equal
//! times the order is fixed (truth, sensors in the file's order, arrivals in order of sensor and sequence, controllers, pictures, clock),
//! so that equal runs make equal bytes.

#![expect(clippy::disallowed_types, reason = "world side: the run drives world and observers")]

use crate::ahead::read_ahead;
use crate::build;
use crate::checkpoints::Checkpoints;
use crate::control::{self, Control};
use crate::error::RunError;
use crate::events::{RunEvent, RunHeader, RunObserver, SceneOwner, TrackUpdate};
use crate::faults::{Fate, Faults};
use crate::judge::{PlacedMap, judge};
use crate::track::{Step, Track};
use lumenav_core::time::{NANOSECONDS_PER_SECOND, nanoseconds};
use lumenav_core::{
    CapsuleTruth, ModalityError, Name, Observation, PathMap, Primitive, RandomStreams, Reading,
    ReadingStream, Recorded, Registry, Sensor, SimTime,
};
use lumenav_fusion::{Counters, Hindsight, Turn};
use lumenav_scenario::file::RecordTable;
use lumenav_scenario::world::WorldNote;
use lumenav_scenario::{ScenarioFile, World};
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What happens next; the derived order breaks ties at equal times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Truth,
    Due(usize),
    Arrival(usize, u64),
    Control(usize),
    Scene,
    Clock,
}

/// What a run leaves behind, besides what its observers wrote.
#[derive(Clone, Debug, Default)]
pub struct RunSummary {
    /// Simulated time.
    pub ended_at: SimTime,
    /// Counters of each track's filter.
    pub counters: BTreeMap<String, Counters>,
    /// Readings taken, over all sensors.
    pub readings: u64,
    /// Why a state of the world could not be kept, the first time; the run went on.
    pub not_kept: Option<String>,
}

/// A world with its map, ready to run.
pub struct Stage {
    /// Where its states are kept, and taken up; `None`: nowhere.
    pub checkpoints: Option<Checkpoints>,
    /// The world.
    pub world: Box<dyn World>,
    /// The tract as a map for evaluation.
    pub map: Option<Arc<dyn PathMap>>,
}

/// What a run shows to whoever watches: all observers, each told the same.
pub struct Observers<'o> {
    all: Vec<&'o mut dyn RunObserver>,
}

impl<'o> Observers<'o> {
    /// These observers, told in this order.
    pub fn new(all: Vec<&'o mut dyn RunObserver>) -> Self {
        Self { all }
    }

    fn start(&mut self, header: &RunHeader) -> Result<(), RunError> {
        self.all.iter_mut().try_for_each(|o| o.start(header)).map_err(RunError::from)
    }

    pub(crate) fn tell(&mut self, event: &RunEvent<'_>) -> Result<(), RunError> {
        self.all.iter_mut().try_for_each(|o| o.on(event)).map_err(RunError::from)
    }

    fn finish(&mut self) -> Result<(), RunError> {
        self.all.iter_mut().try_for_each(|o| o.finish()).map_err(RunError::from)
    }
}

/// Asked now and then whether to stop.
pub type StopRequest<'s> = &'s (dyn Fn() -> bool + Sync);

/// Simulates a scenario.
///
/// # Errors
/// [`RunError`]; observers that have files open are dropped without finishing them.
pub fn simulate(
    file: &ScenarioFile,
    registry: &Registry,
    seed: u64,
    trial: u64,
    stage: Stage,
    observers: &mut Observers<'_>,
    stop: StopRequest<'_>,
) -> Result<RunSummary, RunError> {
    let Some(duration_s) = file.scenario.duration_s else {
        return Err(file
            .node
            .child_or_empty("scenario")
            .error("`duration_s` is missing; give seconds above 0")
            .into());
    };
    let header = build::header(file, seed, trial, true)?;
    let begin = SimTime(nanoseconds(file.scenario.observe_from_s.0));
    let mut run = Simulation {
        streams: RandomStreams::new(seed, trial, ""),
        sensors: build::sensors(file, registry, stage.map.as_ref())?,
        tracks: build::tracks(file, registry, stage.map.as_ref())?,
        controls: Vec::new(),
        faults: Faults::new(file.faults.clone()),
        world: stage.world,
        map: stage.map,
        checkpoints: stage.checkpoints,
        queue: BTreeMap::new(),
        begin,
        end: SimTime(nanoseconds(duration_s.0)),
        keep_ns: 0,
        truth_period_ns: nanoseconds(1.0 / file.record.truth_rate_hz.0).max(1),
        scene_period_ns: nanoseconds(1.0 / file.record.scene_rate_hz.0).max(1),
        summary: RunSummary::default(),
    };
    run.controls = control::controls(file, &mut run.sensors)?;
    observers.start(&header)?;
    run.keep_ns = run.longest_look_back_ns(file);
    run.come_to_begin(observers, stop)?;
    run.announce(file, observers)?;
    run.fill_queue();
    run.go(observers, stop)?;
    observers.finish()?;
    Ok(run.summary)
}

/// The truth at an instant, where it is known.
pub type TruthAt<'t> = &'t dyn Fn(SimTime) -> Option<CapsuleTruth>;

/// Runs recorded data through the tracks of a replay. `truth` is a reference trajectory, where there is one; at instants
/// where it is not known nothing is judged.
///
/// # Errors
/// As [`simulate`].
pub fn replay(
    file: &ScenarioFile,
    registry: &Registry,
    truth: Option<TruthAt<'_>>,
    observers: &mut Observers<'_>,
    stop: StopRequest<'_>,
) -> Result<RunSummary, RunError> {
    if let Some(controller) = file.controllers.first() {
        return Err(controller
            .node
            .error("a replay has no controllers: what was recorded does not move")
            .into());
    }
    let header = build::header(file, file.scenario.seed, 0, truth.is_some())?;
    let mut tracks = build::tracks(file, registry, None)?;
    let mut streams = Vec::new();
    let mut summary = RunSummary::default();
    observers.start(&header)?;
    for (name, stream) in build::readers(file, registry)? {
        let mut stream = read_ahead(stream);
        let ahead = next_reading(&name, &mut stream, SimTime::ZERO, observers)?;
        streams.push((name, stream, ahead));
    }
    let mut clock = ReplayClock::new(&file.record);
    let begin = SimTime(nanoseconds(file.scenario.observe_from_s.0));
    while let Some(reading) = earliest(&mut streams, observers)? {
        if stop() {
            return Err(RunError::Stopped { at: reading.arrival });
        }
        if reading.interval.0 < begin {
            continue;
        }
        clock.advance_to(reading.arrival, &tracks, observers)?;
        if let Some(truth) = truth.and_then(|truth| truth(reading.at())) {
            observers.tell(&RunEvent::Truth(&truth))?;
        }
        observers.tell(&RunEvent::Reading { reading: &reading, labels: None })?;
        summary.readings += 1;
        summary.ended_at = summary.ended_at.max(reading.arrival);
        let judge_with = |at: SimTime| truth.and_then(|truth| truth(at));
        feed(&mut tracks, &reading, &judge_with, None, observers)?;
    }
    observers.finish()?;
    summary.counters = counters(&tracks);
    Ok(summary)
}

/// A stream of recorded readings with the next one already read.
type Ahead = (Name, ReadingStream, Option<Reading>);

/// The reading that arrived first of all streams; ties go to the file's order.
fn earliest(streams: &mut [Ahead], observers: &mut Observers<'_>) -> Result<Option<Reading>, RunError> {
    let first = streams
        .iter()
        .enumerate()
        .filter_map(|(i, (_, _, ahead))| ahead.as_ref().map(|reading| (reading.arrival, i)))
        .min();
    let Some((_, index)) = first else { return Ok(None) };
    let (name, stream, ahead) = &mut streams[index];
    let reading = ahead.take();
    let now = reading.as_ref().map_or(SimTime::ZERO, |reading| reading.arrival);
    *ahead = next_reading(name, stream, now, observers)?;
    Ok(reading)
}

/// The next reading of a stream; what is passed over on the way is told as missing.
fn next_reading(
    sensor: &Name,
    stream: &mut ReadingStream,
    now: SimTime,
    observers: &mut Observers<'_>,
) -> Result<Option<Reading>, RunError> {
    loop {
        match stream.next().transpose()? {
            Some(Recorded::Reading(reading)) => return Ok(Some(reading)),
            Some(Recorded::Skipped(error)) => {
                let why = format!("passed over: {error}");
                observers.tell(&RunEvent::Missing { sensor, at: now, why: &why })?;
            }
            None => return Ok(None),
        }
    }
}

/// Ticks between recorded readings, so that a hole in the data is seen as time without an estimate.
struct ReplayClock {
    next_tick: Option<SimTime>,
    next_scene: Option<SimTime>,
    tick_period_ns: i64,
    scene_period_ns: i64,
}

/// More ticks than this are not told of one hole in the data (eleven days): the step grows instead.
const MAX_TICKS_PER_HOLE: i64 = 1_000_000;

impl ReplayClock {
    fn new(record: &RecordTable) -> Self {
        let period_ns = |rate_hz: f64| nanoseconds(1.0 / rate_hz).max(1);
        Self {
            next_tick: None,
            next_scene: None,
            tick_period_ns: period_ns(record.truth_rate_hz.0),
            scene_period_ns: period_ns(record.scene_rate_hz.0),
        }
    }

    fn advance_to(
        &mut self,
        to: SimTime,
        tracks: &[Track],
        observers: &mut Observers<'_>,
    ) -> Result<(), RunError> {
        let mut tick = *self.next_tick.get_or_insert(to);
        let step_ns = (to.0.saturating_sub(tick.0) / MAX_TICKS_PER_HOLE).max(self.tick_period_ns);
        while tick <= to {
            observers.tell(&RunEvent::Clock { at: tick })?;
            tick = tick + step_ns;
        }
        self.next_tick = Some(tick);
        let scene = *self.next_scene.get_or_insert(to);
        if scene <= to {
            picture_of_tracks(to, tracks, observers)?;
            self.next_scene = Some(to + self.scene_period_ns);
        }
        Ok(())
    }
}

fn tell_notes(notes: &[WorldNote], observers: &mut Observers<'_>) -> Result<(), RunError> {
    notes.iter().try_for_each(|note| {
        observers.tell(&RunEvent::Note { at: note.at, source: "world", text: &note.text })
    })
}

fn counters(tracks: &[Track]) -> BTreeMap<String, Counters> {
    tracks.iter().filter_map(|t| t.filter().map(|f| (t.name.to_string(), f.counters().clone()))).collect()
}

/// Hands a reading to every track that uses its sensor and tells the observers what came of it.
fn feed(
    tracks: &mut [Track],
    reading: &Reading,
    truth_at: TruthAt<'_>,
    map: Option<PlacedMap<'_>>,
    observers: &mut Observers<'_>,
) -> Result<(), RunError> {
    for track in tracks {
        let steps = track.process(reading).map_err(|source| RunError::Sensor {
            sensor: reading.sensor.to_string(),
            at: reading.at(),
            source,
        })?;
        for step in steps {
            tell_step(track, reading, &step, truth_at, map, observers)?;
        }
    }
    Ok(())
}

/// What the front ends of all tracks draw.
fn picture_of_tracks(at: SimTime, tracks: &[Track], observers: &mut Observers<'_>) -> Result<(), RunError> {
    for track in tracks {
        for input in &track.inputs {
            let mut primitives = Vec::new();
            if let Some(front_end) = &input.front_end {
                front_end.scene(&mut primitives);
            }
            if !primitives.is_empty() {
                let owner = SceneOwner::Track { track: track.name.clone(), sensor: input.sensor.clone() };
                observers.tell(&RunEvent::Scene { at, owner: &owner, primitives: &primitives })?;
            }
        }
    }
    Ok(())
}

fn tell_step(
    track: &mut Track,
    reading: &Reading,
    step: &Step,
    truth_at: TruthAt<'_>,
    map: Option<PlacedMap<'_>>,
    observers: &mut Observers<'_>,
) -> Result<(), RunError> {
    let name = track.name.clone();
    if let Some(why) = &step.refusal {
        observers.tell(&RunEvent::Refused {
            track: &name,
            sensor: &reading.sensor,
            sequence: reading.sequence,
            at: reading.at(),
            measurement: step.measurement.as_ref(),
            why,
        })?;
    }
    if let Some(lost) = &step.lost {
        let text = format!("belief given up: {lost}");
        observers.tell(&RunEvent::Note { at: reading.at(), source: &name, text: &text })?;
    }
    for seen in &step.hindsight {
        let text = in_hindsight(seen, reading);
        observers.tell(&RunEvent::Note { at: seen.at, source: &name, text: &text })?;
    }
    let Some(estimate) = &step.estimate else { return Ok(()) };
    if step.started {
        let text = format!("belief started from a fix of sensor `{}`", reading.sensor);
        observers.tell(&RunEvent::Note { at: estimate.at, source: &name, text: &text })?;
    }
    let truth = truth_at(estimate.at);
    // A bound belongs to a track that is nothing but its measurements; a filter knows more than the last of them.
    let bound_of = step.measurement.as_ref().filter(|_| track.filter().is_none());
    let error = truth.as_ref().filter(|_| !step.revision).map(|t| judge(estimate, t, bound_of, map));
    let block = estimate.pose.covariance.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigen();
    let largest = block.eigenvalues.imax();
    observers.tell(&RunEvent::Update(&TrackUpdate {
        track: &name,
        sensor: &reading.sensor,
        update: track.updates,
        estimate,
        revision: step.revision,
        nis: step.nis,
        weakest: (
            block.eigenvalues[largest].max(0.0).sqrt(),
            block.eigenvectors.column(largest).into_owned(),
        ),
        started: step.starts_anew(),
        accepted: step.refusal.is_none(),
        truth: truth.as_ref(),
        error: error.as_ref(),
        compute_s: step.compute_s,
    }))?;
    track.updates += 1;
    Ok(())
}

/// What a late reading has changed of the past, in words. A loss begins with the words of one in time.
fn in_hindsight(seen: &Hindsight, late: &Reading) -> String {
    let what = match &seen.turn {
        Turn::Lost { why, .. } => format!("belief given up: {why}"),
        Turn::NotLost => "the belief was not given up here after all".to_owned(),
        Turn::Started => format!("belief started from a fix of sensor `{}`", seen.sensor),
        Turn::NotStarted => "the belief was not started here after all".to_owned(),
    };
    format!(
        "{what} (seen at {}, when the reading of {} of sensor `{}` came late)",
        late.arrival,
        late.at(),
        late.sensor
    )
}

/// A simulation under way.
struct Simulation {
    streams: RandomStreams,
    sensors: Vec<(Name, Box<dyn Sensor>)>,
    tracks: Vec<Track>,
    controls: Vec<Control>,
    faults: Faults,
    world: Box<dyn World>,
    map: Option<Arc<dyn PathMap>>,
    /// Events by time and kind; arrivals carry their observation.
    queue: BTreeMap<(SimTime, Kind), Option<Observation>>,
    checkpoints: Option<Checkpoints>,
    /// From here on anybody looks.
    begin: SimTime,
    end: SimTime,
    /// How much truth behind the present is kept.
    keep_ns: i64,
    truth_period_ns: i64,
    scene_period_ns: i64,
    summary: RunSummary,
}

impl Simulation {
    /// Tells what is known beforehand: the static picture and the faults to come.
    fn announce(&mut self, file: &ScenarioFile, observers: &mut Observers<'_>) -> Result<(), RunError> {
        let mut primitives: Vec<Primitive> = Vec::new();
        self.world.static_scene(&mut primitives);
        let at = self.begin;
        observers.tell(&RunEvent::Scene { at, owner: &SceneOwner::World, primitives: &primitives })?;
        for fault in &file.faults {
            let (_, start_s, _) = fault.place();
            let at = SimTime::from_seconds(start_s);
            observers.tell(&RunEvent::Note { at, source: "fault", text: &fault.describe() })?;
        }
        Ok(())
    }

    fn fill_queue(&mut self) {
        self.queue.insert((self.begin, Kind::Truth), None);
        self.queue.insert((self.begin, Kind::Scene), None);
        self.queue.insert((self.begin, Kind::Clock), None);
        for (index, (_, sensor)) in self.sensors.iter().enumerate() {
            self.queue.insert((sensor.next_due(), Kind::Due(index)), None);
        }
        for index in 0..self.controls.len() {
            self.queue.insert((self.begin, Kind::Control(index)), None);
        }
    }

    /// How much truth behind the present anybody may ask for.
    fn longest_look_back_ns(&self, file: &ScenarioFile) -> i64 {
        let look_back = self.sensors.iter().map(|(_, s)| s.look_back_ns()).max().unwrap_or(0);
        let latency_s = file.sensors.iter().filter_map(|s| s.schedule).map(|s| s.latency_ms.0 * 1e-3);
        let delay_s: f64 = file
            .faults
            .iter()
            .map(|f| {
                if let lumenav_scenario::Fault::Delay { delay_ms, .. } = f { delay_ms.0 * 1e-3 } else { 0.0 }
            })
            .sum();
        look_back.saturating_add(
            nanoseconds(latency_s.fold(0.0, f64::max) + delay_s).saturating_add(NANOSECONDS_PER_SECOND),
        )
    }

    /// Lets the world run alone until it is looked at: from zero, or from the latest state of it that was kept.
    fn come_to_begin(
        &mut self,
        observers: &mut Observers<'_>,
        stop: StopRequest<'_>,
    ) -> Result<(), RunError> {
        if self.begin == SimTime::ZERO {
            return Ok(());
        }
        // Who does not look is told nothing but what still holds, wherever the world came from.
        let mut notes = self.world.take_notes();
        notes.retain(|note| note.standing);
        notes.iter_mut().for_each(|note| note.at = self.begin);
        let mut at = SimTime::ZERO;
        if let Some(checkpoints) = &mut self.checkpoints {
            let until = self.begin - self.keep_ns;
            at = checkpoints.take_up(&mut *self.world, until)?.unwrap_or(at);
        }
        while at < self.begin {
            if stop() {
                return Err(RunError::Stopped { at });
            }
            at = (at + NANOSECONDS_PER_SECOND).min(self.begin);
            self.world.advance_to(at)?;
            self.world.forget_before(at - self.keep_ns);
            notes.extend(self.world.take_notes().into_iter().filter(|note| note.at >= self.begin));
            self.keep_checkpoint(at);
            observers.tell(&RunEvent::Unobserved { at })?;
        }
        tell_notes(&notes, observers)?;
        self.sensors.iter_mut().for_each(|(_, sensor)| sensor.skip_to(self.begin));
        Ok(())
    }

    /// A state that cannot be kept costs the next run time, and this one nothing.
    fn keep_checkpoint(&mut self, at: SimTime) {
        let Some(checkpoints) = &mut self.checkpoints else { return };
        if !checkpoints.is_due(at) {
            return;
        }
        let kept = self.world.checkpoint().map_or(Ok(()), |state| checkpoints.keep(at, &state));
        if let Err(error) = kept {
            self.summary.not_kept.get_or_insert(error.to_string());
        }
    }

    fn go(&mut self, observers: &mut Observers<'_>, stop: StopRequest<'_>) -> Result<(), RunError> {
        while let Some(((at, kind), observation)) = self.queue.pop_first() {
            if at > self.end {
                break;
            }
            self.world.advance_to(at)?;
            self.pass_on_notes(observers)?;
            match kind {
                Kind::Truth => {
                    observers.tell(&RunEvent::Truth(&self.world.truth().capsule(at)))?;
                    self.queue.insert((at + self.truth_period_ns, Kind::Truth), None);
                }
                Kind::Due(index) => self.observe(index, at, observers)?,
                Kind::Arrival(..) => self.arrive(observation, observers)?,
                Kind::Control(index) => {
                    let control = &mut self.controls[index];
                    control.step(at, &self.tracks, &mut self.sensors, observers)?;
                    self.queue.insert((at + control.period_ns, Kind::Control(index)), None);
                }
                Kind::Scene => {
                    self.picture(at, observers)?;
                    self.queue.insert((at + self.scene_period_ns, Kind::Scene), None);
                }
                Kind::Clock => {
                    if stop() {
                        return Err(RunError::Stopped { at });
                    }
                    self.world.forget_before(at - self.keep_ns);
                    self.keep_checkpoint(at);
                    observers.tell(&RunEvent::Clock { at })?;
                    self.queue.insert((at + NANOSECONDS_PER_SECOND, Kind::Clock), None);
                }
            }
        }
        self.summary.ended_at = self.end;
        self.summary.counters = counters(&self.tracks);
        Ok(())
    }

    fn pass_on_notes(&mut self, observers: &mut Observers<'_>) -> Result<(), RunError> {
        tell_notes(&self.world.take_notes(), observers)
    }

    fn observe(&mut self, index: usize, at: SimTime, observers: &mut Observers<'_>) -> Result<(), RunError> {
        let (name, sensor) = &mut self.sensors[index];
        let streams = self.streams.for_component(name);
        let observation = sensor
            .observe(self.world.truth(), at, &streams)
            .map_err(|source| RunError::Sensor { sensor: name.to_string(), at, source })?;
        let next = sensor.next_due();
        if next <= at {
            let source =
                ModalityError::Reading("the sensor's next reading is not due later than this one".to_owned());
            return Err(RunError::Sensor { sensor: name.to_string(), at, source });
        }
        self.queue.insert((next, Kind::Due(index)), None);
        let Some(Observation { reading, labels }) = observation else {
            return observers.tell(&RunEvent::Missing { sensor: name, at, why: "lost on the way" });
        };
        match self.faults.befall(reading, &streams)? {
            Fate::Lost(why) => observers.tell(&RunEvent::Missing { sensor: name, at, why: &why }),
            Fate::Passed(reading) => {
                let sequence = reading.sequence;
                let key = (reading.arrival.max(at), Kind::Arrival(index, sequence));
                if self.queue.insert(key, Some(Observation { reading: *reading, labels })).is_some() {
                    let why = format!("two readings carry the sequence number {sequence}");
                    let source = ModalityError::Reading(why);
                    return Err(RunError::Sensor { sensor: name.to_string(), at, source });
                }
                Ok(())
            }
        }
    }

    fn arrive(
        &mut self,
        observation: Option<Observation>,
        observers: &mut Observers<'_>,
    ) -> Result<(), RunError> {
        // Arrivals are queued with their observation.
        let Some(Observation { reading, labels }) = observation else { return Ok(()) };
        self.summary.readings += 1;
        observers.tell(&RunEvent::Reading { reading: &reading, labels: labels.as_ref() })?;
        let world = &self.world;
        let truth_at = |at: SimTime| Some(world.truth().capsule(at));
        let world_from_map = |at: SimTime| world.truth().frame("gut", at).unwrap_or_else(Isometry3::identity);
        let map = self.map.as_deref().map(|map| PlacedMap { map, world_from_map: &world_from_map });
        feed(&mut self.tracks, &reading, &truth_at, map, observers)
    }

    fn picture(&mut self, at: SimTime, observers: &mut Observers<'_>) -> Result<(), RunError> {
        let mut primitives = Vec::new();
        self.world.moving_scene(&mut primitives);
        if !primitives.is_empty() {
            observers.tell(&RunEvent::Scene { at, owner: &SceneOwner::World, primitives: &primitives })?;
        }
        for (name, sensor) in &self.sensors {
            let mut primitives = Vec::new();
            sensor.scene(&mut primitives);
            if !primitives.is_empty() {
                let owner = SceneOwner::Sensor(name.clone());
                observers.tell(&RunEvent::Scene { at, owner: &owner, primitives: &primitives })?;
            }
        }
        picture_of_tracks(at, &self.tracks, observers)
    }
}
