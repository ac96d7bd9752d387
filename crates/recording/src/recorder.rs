//! The observer: from events of a run to rows of a recording.

#![expect(clippy::disallowed_types, reason = "world side: a recording shows the truth beside the estimates")]

use crate::blueprint::{self, Layout};
use crate::bursts::{Bursts, Line};
use crate::drawn::Drawn;
use crate::error::RecordingError;
use crate::geometry::{band_95, ellipsoid, point_m};
use crate::output::Output;
use crate::pacing::{Class, Gate, Pace};
use crate::palette;
use crate::primitives;
use crate::store::{Store, entity, row_bytes, time_point};
use lumenav_core::{CapsuleTruth, FixKind, Name, Primitive, SimTime};
use lumenav_pipeline::{ObserverError, Refusal, RunEvent, RunHeader, RunObserver, SceneOwner, TrackUpdate};
use rerun::external::re_log_types::TimePoint;
use rerun::{AsComponents, Color, EntityPath, StoreId};
use std::collections::BTreeMap;
use std::path::Path;

/// A plot's line is not drawn over a longer gap between a track's updates than this, ns.
const GAP_NS: i64 = 1_000_000_000;

/// What to keep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecorderOptions {
    /// Keep every row of every stream (`--record full`); otherwise the size is bounded, see the module `pacing`.
    pub full: bool,
}

/// Records a run into an `.rrd` file or a running viewer.
pub struct RrdRecorder {
    output: Output,
    options: RecorderOptions,
    run: Option<Run>,
    target: String,
}

/// The state of one run.
struct Run {
    store: Store,
    header: RunHeader,
    pace: Pace,
    layout: Layout,
    truth: Drawn,
    /// Where the capsule was last.
    segment: Option<Name>,
    tracks: BTreeMap<Name, Drawn>,
    scenes: BTreeMap<String, Scene>,
    bursts: Bursts,
    /// Degrees of freedom for which there is a band in the NEES plot.
    bands: Vec<usize>,
    highest_nees: f64,
    last: SimTime,
}

/// An entity that a plugin draws.
struct Scene {
    gate: Gate,
    last: Option<u64>,
}

impl RrdRecorder {
    /// Records into a file, which appears under its name when the run has finished.
    ///
    /// # Errors
    /// [`RecordingError::File`] where nothing can be written there.
    pub fn to_file(path: &Path, options: RecorderOptions) -> Result<Self, RecordingError> {
        let output = Output::file(path)?;
        Ok(Self { output, options, run: None, target: path.display().to_string() })
    }

    /// Sends to a viewer that listens at `host:port` or `rerun+http://host:port/proxy`.
    ///
    /// # Errors
    /// [`RecordingError::Address`], or [`RecordingError::NoViewer`] where nothing answers within ten seconds.
    pub fn to_viewer(address: &str, options: RecorderOptions) -> Result<Self, RecordingError> {
        let output = Output::viewer(address)?;
        Ok(Self { output, options, run: None, target: address.to_owned() })
    }

    /// Why a viewer did not get everything (it was closed, say); to be told to the user. A run does not fail by it.
    pub fn lost_viewer(&self) -> Option<&str> {
        self.output.lost()
    }

    fn with_run(
        &mut self,
        act: impl FnOnce(&mut Run, &mut Output) -> Result<(), RecordingError>,
    ) -> Result<(), ObserverError> {
        let Some(run) = self.run.as_mut() else { return Ok(()) };
        act(run, &mut self.output).map_err(|e| ObserverError::new(format!("recording {}", self.target), e))
    }
}

impl RunObserver for RrdRecorder {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        let run = Run::start(header, self.options, &mut self.output)
            .map_err(|e| ObserverError::new(format!("recording {}", self.target), e))?;
        self.run = Some(run);
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.with_run(|run, output| run.on(output, event))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.with_run(Run::finish)
    }
}

impl Run {
    fn start(
        header: &RunHeader,
        options: RecorderOptions,
        output: &mut Output,
    ) -> Result<Self, RecordingError> {
        let id = format!("{}-seed{}-trial{}", header.scenario, header.seed, header.trial);
        let mut store = Store::open(StoreId::recording("lumenav", id), output)?;
        let name = rerun::RecordingInfo::update_fields()
            .with_name(format!("{}, seed {}", header.scenario, header.seed));
        store.log(output, &EntityPath::properties(), TimePoint::default(), &name)?;
        let axes = rerun::ViewCoordinates::RFU();
        store.log(output, &entity("world"), TimePoint::default(), &axes)?;
        let tracks: BTreeMap<Name, Drawn> = header
            .tracks
            .iter()
            .enumerate()
            .map(|(i, t)| {
                (t.name.clone(), Drawn::new(format!("world/tracks/{}", t.name), "pose", palette::track(i)))
            })
            .collect();
        let lasts_s = header.duration_s.map_or(f64::INFINITY, |end_s| end_s - header.observe_from_s);
        let mut layout = Layout { has_truth: header.has_truth, lasts_s, ..Layout::default() };
        layout.paths = tracks.values().map(|t| entity(&format!("{}/path", t.root)).to_string()).collect();
        layout.paths.push("/world/capsule/path".to_owned());
        let mut run = Self {
            store,
            pace: Pace { full: options.full, duration_s: header.duration_s.map(|_| lasts_s) },
            layout,
            truth: Drawn::new("world/capsule".to_owned(), "truth", palette::TRUTH),
            segment: None,
            tracks,
            scenes: BTreeMap::new(),
            bursts: Bursts::default(),
            bands: Vec::new(),
            highest_nees: 0.0,
            last: SimTime::ZERO,
            header: header.clone(),
        };
        run.name_plots(output)?;
        if output.is_live() {
            blueprint::send(output, run.store.id(), &run.layout, 0)?;
        }
        Ok(run)
    }

    /// Names and colours of the lines in the plots, once for the whole run.
    fn name_plots(&mut self, output: &mut Output) -> Result<(), RecordingError> {
        for track in &self.header.tracks {
            let Some(drawn) = self.tracks.get(&track.name) else { continue };
            let style = rerun::SeriesLines::new()
                .with_colors([Color::from_u32(drawn.colour)])
                .with_names([track.name.to_string()])
                .with_widths([1.5_f32]);
            for plot in ["error", "nees", "along_tract"] {
                let path = entity(&format!("plots/{plot}/{}", track.name));
                self.store.log(output, &path, TimePoint::default(), &style)?;
            }
        }
        let truth = rerun::SeriesLines::new()
            .with_colors([Color::from_u32(palette::TRUTH)])
            .with_names(["truth"])
            .with_widths([2.5_f32]);
        self.store.log(output, &entity("plots/along_tract/truth"), TimePoint::default(), &truth)
    }

    fn on(&mut self, output: &mut Output, event: &RunEvent<'_>) -> Result<(), RecordingError> {
        match event {
            RunEvent::Truth(truth) => self.on_truth(output, truth),
            RunEvent::Update(update) => self.on_update(output, update),
            RunEvent::Scene { at, owner, primitives } => {
                self.see(output, *at)?;
                primitives.iter().try_for_each(|primitive| self.on_primitive(output, *at, owner, primitive))
            }
            RunEvent::Refused { track, sensor, at, why, .. } => {
                let (kind, text) = refusal(why);
                let line = self.bursts.push(&format!("{track} refuses {sensor} ({kind})"), *at, text);
                let line = line.map(|l| Line { text: format!("{track} refuses {sensor}: {}", l.text), ..l });
                self.tell(output, "refusals", line, rerun::TextLogLevel::WARN)
            }
            RunEvent::Missing { sensor, at, why } => {
                let line = self.bursts.push(&format!("{sensor}: no reading ({why})"), *at, (*why).to_owned());
                let line = line.map(|l| Line { text: format!("{sensor}: no reading: {}", l.text), ..l });
                self.tell(output, "missing", line, rerun::TextLogLevel::WARN)
            }
            RunEvent::Note { at, source, text } => {
                let level =
                    if *source == "fault" { rerun::TextLogLevel::WARN } else { rerun::TextLogLevel::INFO };
                let line = Line { at: *at, text: format!("{source}: {text}") };
                self.tell(output, "notes", Some(line), level)
            }
            RunEvent::Clock { at } => {
                self.see(output, *at)?;
                if output.is_live() {
                    self.draw_bands(output, *at)?;
                    self.store.flush(output)?;
                }
                Ok(())
            }
            RunEvent::Command { controller, at, world_from_sensor, .. } => {
                self.layout.moved = true;
                let z_mm = 1e3 * world_from_sensor.translation.z;
                self.plot(output, "moved", controller, &time_point(*at, None), z_mm).map(|_| ())
            }
            RunEvent::Reading { .. } | RunEvent::Unobserved { .. } => Ok(()),
        }
    }

    /// Time moved on: bursts that have ended are closed.
    fn see(&mut self, output: &mut Output, at: SimTime) -> Result<(), RecordingError> {
        self.last = self.last.max(at);
        for line in self.bursts.ended(at) {
            self.tell(output, "refusals", Some(line), rerun::TextLogLevel::WARN)?;
        }
        Ok(())
    }

    fn tell(
        &mut self,
        output: &mut Output,
        where_to: &str,
        line: Option<Line>,
        level: &str,
    ) -> Result<(), RecordingError> {
        let Some(line) = line else { return Ok(()) };
        let row = rerun::TextLog::new(line.text).with_level(level);
        self.store.log(output, &entity(&format!("events/{where_to}")), time_point(line.at, None), &row)
    }

    fn on_truth(&mut self, output: &mut Output, truth: &CapsuleTruth) -> Result<(), RecordingError> {
        self.see(output, truth.at)?;
        self.layout.include(point_m(&truth.world_from_capsule.translation.vector));
        if let Some(arc_m) = truth.arc_length_m {
            let [low_m, high_m] = self.layout.along_m.unwrap_or([arc_m; 2]);
            self.layout.along_m = Some([low_m.min(arc_m), high_m.max(arc_m)]);
            self.truth.shows_speed = true;
            self.tell_segment(output, truth)?;
        }
        let at_s = truth.at.seconds();
        if !self.truth.gate.is_open(at_s) {
            return Ok(());
        }
        let time = time_point(truth.at, None);
        let mut bytes = self.truth.move_to(
            &mut self.store,
            output,
            &self.header,
            &time,
            &truth.world_from_capsule,
            FixKind::Full,
        )?;
        bytes +=
            self.truth.walk(&mut self.store, output, truth.at, &truth.world_from_capsule, self.pace.full)?;
        if let Some(arc_m) = truth.arc_length_m {
            bytes += self.plot(output, "along_tract", "truth", &time, arc_m)?;
        }
        let rest = self.pace.rest_s(Class::Track, self.tracks.len() + 1, bytes, at_s);
        self.truth.gate.close(at_s, rest);
        Ok(())
    }

    /// The timeline of the segments: a row when the capsule comes into another one, or leaves the tract.
    fn tell_segment(&mut self, output: &mut Output, truth: &CapsuleTruth) -> Result<(), RecordingError> {
        if self.segment == truth.segment {
            return Ok(());
        }
        self.segment.clone_from(&truth.segment);
        let state = rerun::archetypes::StateChange::new()
            .with_state_opt([truth.segment.as_ref().map(ToString::to_string)]);
        self.store.log(output, &entity("segment"), time_point(truth.at, None), &state)
    }

    fn on_update(&mut self, output: &mut Output, update: &TrackUpdate<'_>) -> Result<(), RecordingError> {
        let estimate = update.estimate;
        self.see(output, estimate.at)?;
        let streams = self.tracks.len() + 1;
        let Some(drawn) = self.tracks.get_mut(update.track) else { return Ok(()) };
        let at_s = estimate.at.seconds();
        if update.started {
            drawn.lift(&mut self.store, output, estimate.at)?;
        }
        let last = drawn.last.replace(estimate.at);
        drawn.gap |= last.is_some_and(|last| estimate.at - last > GAP_NS);
        if !drawn.gate.is_open(at_s) {
            return Ok(());
        }
        if std::mem::take(&mut drawn.gap) {
            self.break_lines(output, update)?;
        }
        let Some(drawn) = self.tracks.get_mut(update.track) else { return Ok(()) };
        let time = time_point(estimate.at, Some(update.update));
        let pose = &estimate.pose;
        let mut bytes = drawn.move_to(
            &mut self.store,
            output,
            &self.header,
            &time,
            &pose.world_from_capsule,
            pose.kind,
        )?;
        bytes +=
            drawn.walk(&mut self.store, output, estimate.at, &pose.world_from_capsule, self.pace.full)?;
        let centre = pose.world_from_capsule.translation.vector;
        if !drawn.region {
            drawn.region = true;
            let path = entity(&format!("{}/covariance", drawn.root));
            let style = rerun::Ellipsoids3D::update_fields()
                .with_colors([Color::from_u32(palette::with_alpha(drawn.colour, 0xa0))])
                .with_line_radii([rerun::Radius::new_ui_points(0.5)])
                .with_fill_mode(rerun::FillMode::MajorWireframe);
            self.store.log(output, &path, TimePoint::default(), &style)?;
        }
        if let Some(region) = ellipsoid(&centre, &pose.covariance.fixed_view::<3, 3>(0, 0).into_owned()) {
            let path = entity(&format!("{}/covariance", drawn.root));
            let batches = region.as_serialized_batches();
            bytes += row_bytes(&batches);
            self.store.log_batches(output, &path, time.clone(), batches)?;
        }
        bytes += self.plot_errors(output, update, &time)?;
        let rest = self.pace.rest_s(Class::Track, streams, bytes, at_s);
        if let Some(drawn) = self.tracks.get_mut(update.track) {
            drawn.gate.close(at_s, rest);
        }
        Ok(())
    }

    /// After a gap the plots' lines begin anew: nothing was known in between.
    fn break_lines(&mut self, output: &mut Output, update: &TrackUpdate<'_>) -> Result<(), RecordingError> {
        if update.error.is_none() {
            return Ok(());
        }
        let before = time_point(update.estimate.at - 1, Some(update.update));
        for plot in ["error", "nees"] {
            self.plot(output, plot, update.track, &before, f64::NAN)?;
        }
        Ok(())
    }

    fn plot_errors(
        &mut self,
        output: &mut Output,
        update: &TrackUpdate<'_>,
        time: &TimePoint,
    ) -> Result<usize, RecordingError> {
        let Some(error) = update.error else { return Ok(0) };
        let mut bytes =
            self.plot(output, "error", update.track, time, 1e3 * error.position_world_m.norm())?;
        if let Some(nees) = error.nees {
            bytes += self.plot(output, "nees", update.track, time, nees)?;
            if nees.is_finite() {
                self.highest_nees = self.highest_nees.max(nees);
            }
            let n = error.nees_degrees_of_freedom;
            if !self.bands.contains(&n) && band_95(n).is_some() {
                self.bands.push(n);
                self.name_band(output, n)?;
                self.draw_band(output, n, update.estimate.at)?;
            }
        }
        if let (Some(along_m), Some(true_m)) =
            (error.along_tract_m, update.truth.and_then(|t| t.arc_length_m))
        {
            bytes += self.plot(output, "along_tract", update.track, time, true_m + along_m)?;
        }
        Ok(bytes)
    }

    fn plot(
        &mut self,
        output: &mut Output,
        plot: &str,
        line: &str,
        time: &TimePoint,
        value: f64,
    ) -> Result<usize, RecordingError> {
        let batches = rerun::Scalars::single(value).as_serialized_batches();
        let bytes = row_bytes(&batches);
        self.store.log_batches(output, &entity(&format!("plots/{plot}/{line}")), time.clone(), batches)?;
        Ok(bytes)
    }

    fn name_band(&mut self, output: &mut Output, n: usize) -> Result<(), RecordingError> {
        let style = rerun::SeriesLines::new()
            .with_colors([Color::from_u32(palette::BAND)])
            .with_names([format!("2.5 %, {n} dof"), format!("{n} dof"), format!("97.5 %, {n} dof")])
            .with_widths([1.0_f32, 2.0, 1.0]);
        self.store.log(output, &entity(&format!("plots/nees/band_{n}_dof")), TimePoint::default(), &style)
    }

    fn draw_band(&mut self, output: &mut Output, n: usize, at: SimTime) -> Result<(), RecordingError> {
        let Some(band) = band_95(n) else { return Ok(()) };
        let path = entity(&format!("plots/nees/band_{n}_dof"));
        self.store.log(output, &path, time_point(at, None), &rerun::Scalars::new(band))
    }

    fn draw_bands(&mut self, output: &mut Output, at: SimTime) -> Result<(), RecordingError> {
        self.bands.clone().into_iter().try_for_each(|n| self.draw_band(output, n, at))
    }

    fn on_primitive(
        &mut self,
        output: &mut Output,
        at: SimTime,
        owner: &SceneOwner,
        primitive: &Primitive,
    ) -> Result<(), RecordingError> {
        let path = primitives::path(owner, primitive);
        let streams = self.scenes.len().max(1);
        let scene = self.scenes.entry(path.clone()).or_insert(Scene { gate: Gate::new(), last: None });
        if !self.pace.full && !scene.gate.is_open(at.seconds()) {
            return Ok(());
        }
        let batches = primitives::components(owner, primitive);
        let print = primitives::fingerprint(&batches);
        // A line of text or a number is news even if it is the same as before.
        let repeats = !matches!(primitive, Primitive::Text { .. } | Primitive::Scalar { .. });
        if repeats && scene.last == Some(print) {
            return Ok(());
        }
        // The picture holds what stands there from the start; readings may reach far beyond it.
        if scene.last.is_none() && !matches!(owner, SceneOwner::Track { .. }) {
            for point in primitives::extent_points_m(primitive) {
                self.layout.include(point);
            }
        }
        if matches!(primitive, Primitive::Image { .. }) {
            let camera = path.trim_start_matches("camera/").to_owned();
            self.layout.cameras.insert(camera);
        }
        scene.last = Some(print);
        let rest = self.pace.rest_s(Class::Scene, streams, row_bytes(&batches), at.seconds());
        scene.gate.close(at.seconds(), rest);
        self.store.log_batches(output, &entity(&path), time_point(at, None), batches)
    }

    fn finish(&mut self, output: &mut Output) -> Result<(), RecordingError> {
        for line in self.bursts.all() {
            self.tell(output, "refusals", Some(line), rerun::TextLogLevel::WARN)?;
        }
        let last = self.last;
        self.layout.lasts_s = last.seconds() - self.header.observe_from_s;
        self.draw_bands(output, last)?;
        self.truth.lift(&mut self.store, output, last)?;
        for drawn in self.tracks.values_mut() {
            drawn.lift(&mut self.store, output, last)?;
        }
        self.store.flush(output)?;
        let upper = self.bands.iter().filter_map(|&n| band_95(n)).map(|band| band[2]).fold(0.0, f64::max);
        if upper > 0.0 {
            self.layout.nees_top = Some((1.05 * self.highest_nees).clamp(1.5 * upper, 6.0 * upper));
        }
        blueprint::send(output, self.store.id(), &self.layout, 1)?;
        output.finish()
    }
}

/// Kind of a refusal and its line.
fn refusal(why: &Refusal) -> (&'static str, String) {
    match why {
        Refusal::Gate { chi_square, degrees_of_freedom, threshold, .. } => {
            ("gate", format!("chi² {chi_square:.0} > {threshold:.0} ({degrees_of_freedom:.0} dof)"))
        }
        Refusal::TooLate { by_s } => ("too late", format!("{:.0} ms too late", 1e3 * by_s)),
        Refusal::FrontEnd { why } => ("front end", why.clone()),
        Refusal::NotStarted => {
            ("not started", "the filter has not started and this cannot start it".to_owned())
        }
        Refusal::ContainsPrior => ("contains prior", "its value contains the prior".to_owned()),
        Refusal::Failed { why } => ("failed", why.clone()),
    }
}
