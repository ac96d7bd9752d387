//! What a scenario expects of the motion without a truth (`[expect]`): the figures, and whether they are as the file asks.

use lumenav_core::{Name, SimTime};
use lumenav_evaluation::plausibility::{
    DistanceCheck, DistanceFigures, RestCheck, RestFigures, SpeedCheck, SpeedFigures,
};
use lumenav_pipeline::events::{DistanceTable, ExpectTable};
use lumenav_pipeline::{RunHeader, TrackUpdate};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Checks that need no truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Expectations {
    /// Speed of each track between estimates that a measurement has entered, where a limit is set.
    pub speed: BTreeMap<String, SpeedFigures>,
    /// Distance of the pairs of tracks that are named.
    pub distance: Vec<PairDistance>,
    /// Where the tracks of what rests were.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rest: Vec<TrackRest>,
    /// What the file asks of these figures, and whether they are so.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub verdicts: Vec<ExpectVerdict>,
}

/// Where a track of what rests was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackRest {
    /// The track.
    pub track: String,
    /// `null` where it has no estimate.
    pub figures: Option<RestFigures>,
}

/// Fewer say nothing of a spread: figures are asked to rest on so many, unless the file asks for more.
pub const LEAST_INSTANTS: u32 = 3;

/// One thing that a scenario asks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExpectVerdict {
    /// What is asked, in words, with its unit.
    pub quantity: String,
    /// The figure; `null` where there is nothing to take it from, which is not what is asked.
    pub figure: Option<f64>,
    /// The least and the most that it may be; `null`: no such end.
    pub allowed: [Option<f64>; 2],
    /// Whether it is so.
    pub met: bool,
}

impl ExpectVerdict {
    fn new(quantity: String, figure: Option<f64>, allowed: [Option<f64>; 2]) -> Self {
        let [least, most] = allowed;
        let is_within = |v: f64| least.is_none_or(|least| v >= least) && most.is_none_or(|most| v <= most);
        Self { quantity, figure, allowed, met: figure.is_some_and(is_within) }
    }
}

impl Expectations {
    /// Holds the figures against what is asked.
    fn judge<'a>(&mut self, asked: &ExpectTable, tracks: impl Iterator<Item = &'a Name>) {
        let at_most = |limit: f64| [None, Some(limit)];
        // Nothing at all is no fewer than none.
        let enough = |what: &str, count: usize, least: Option<u32>| {
            let least = f64::from(least.unwrap_or(LEAST_INSTANTS));
            ExpectVerdict::new(what.to_owned(), Some(count as f64), [Some(least), None])
        };
        let mut all = Vec::new();
        if let Some(limit) = asked.max_speed_m_s {
            let least = asked.speed_share.map_or(1.0, |share| share.0);
            for track in tracks {
                let quantity = format!("share of the steps of {track} within {} m/s", limit.0);
                let figure = self.speed.get(&**track).map(|speed| speed.share_within);
                all.push(ExpectVerdict::new(quantity, figure, [Some(least), None]));
                let steps = self.speed.get(&**track).map_or(0, |speed| speed.steps);
                all.push(enough(&format!("steps of {track}"), steps, asked.least_steps));
            }
        }
        for (pair, asked) in self.distance.iter().zip(&asked.distance) {
            let what = format!("distance {} - {}", pair.tracks[0], pair.tracks[1]);
            let figures = pair.figures.as_ref();
            let is_asked = asked.mm.is_some()
                || asked.max_robust_sd_mm.is_some()
                || asked.max_outlier_share.is_some()
                || asked.least_instants.is_some();
            if is_asked {
                let instants = figures.map_or(0, |d| d.instants);
                all.push(enough(&format!("{what}, instants"), instants, asked.least_instants));
            }
            if let Some([low, high]) = asked.mm {
                let mean = figures.map(|d| d.mean_without_outliers_mm);
                let quantity = format!("{what}, mean without outliers, mm");
                all.push(ExpectVerdict::new(quantity, mean, [Some(low.0), Some(high.0)]));
            }
            if let Some(limit) = asked.max_robust_sd_mm {
                let quantity = format!("{what}, robust sd, mm");
                all.push(ExpectVerdict::new(quantity, figures.map(|d| d.robust_sd_mm), at_most(limit.0)));
            }
            if let Some(limit) = asked.max_outlier_share {
                let share = figures.map(|d| d.outliers as f64 / d.instants as f64);
                all.push(ExpectVerdict::new(format!("{what}, share of outliers"), share, at_most(limit.0)));
            }
        }
        for (rest, asked) in self.rest.iter().zip(&asked.rest) {
            let (what, figures) = (format!("rest of {}", rest.track), rest.figures.as_ref());
            let is_asked = asked.max_robust_sd_mm.is_some()
                || asked.max_outlier_share.is_some()
                || asked.least_instants.is_some();
            if is_asked {
                let instants = figures.map_or(0, |r| r.instants);
                all.push(enough(&format!("{what}, instants"), instants, asked.least_instants));
            }
            if let Some(limit) = asked.max_robust_sd_mm {
                let sd = figures.map(|r| r.robust_sd_mm.into_iter().fold(0.0, f64::max));
                let quantity = format!("{what}, largest robust sd along an axis, mm");
                all.push(ExpectVerdict::new(quantity, sd, at_most(limit.0)));
            }
            if let Some(limit) = asked.max_outlier_share {
                let share = figures.map(|r| r.outliers as f64 / r.instants as f64);
                all.push(ExpectVerdict::new(format!("{what}, share of outliers"), share, at_most(limit.0)));
            }
        }
        self.verdicts = all;
    }

    /// What is asked and is not so.
    pub fn unmet(&self) -> impl Iterator<Item = &ExpectVerdict> {
        self.verdicts.iter().filter(|verdict| !verdict.met)
    }
}

/// How far two tracks are apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairDistance {
    /// The tracks.
    pub tracks: [String; 2],
    /// `null` where no instant has an estimate of both.
    pub figures: Option<DistanceFigures>,
}

/// Instants of a pair that wait for the other track: more than any latency makes.
const MOST_WAITING: usize = 1000;

/// A pair of tracks: where each was at instants that the other has not told yet; each instant counts once.
struct Pair {
    tracks: [String; 2],
    waiting: BTreeMap<SimTime, [Option<Vector3<f64>>; 2]>,
    last_paired: Option<SimTime>,
    check: DistanceCheck,
}

impl Pair {
    fn take(&mut self, which: usize, at: SimTime, position_m: Vector3<f64>) {
        if self.last_paired.is_some_and(|last| at <= last) {
            return;
        }
        let places = self.waiting.entry(at).or_default();
        places[which] = Some(position_m);
        if let [Some(a), Some(b)] = places {
            self.check.push(a, b);
            self.last_paired = Some(at);
            self.waiting = self.waiting.split_off(&at);
            self.waiting.remove(&at);
        }
        if self.waiting.len() > MOST_WAITING {
            self.waiting.pop_first();
        }
    }
}

/// Collects what needs no truth.
#[derive(Default)]
pub(crate) struct Plausibility {
    speeds: BTreeMap<Name, SpeedCheck>,
    pairs: Vec<Pair>,
    rests: Vec<(String, RestCheck)>,
}

impl Plausibility {
    pub(crate) fn new(header: &RunHeader) -> Self {
        let limit = header.expect.max_speed_m_s;
        let speeds =
            limit.map(|limit| header.tracks.iter().map(move |t| (t.name.clone(), SpeedCheck::new(limit.0))));
        let pair = |pair: &DistanceTable| Pair {
            tracks: pair.tracks.clone(),
            waiting: BTreeMap::new(),
            last_paired: None,
            check: DistanceCheck::default(),
        };
        Self {
            speeds: speeds.into_iter().flatten().collect(),
            pairs: header.expect.distance.iter().map(pair).collect(),
            rests: header.expect.rest.iter().map(|r| (r.track.clone(), RestCheck::default())).collect(),
        }
    }

    pub(crate) fn update(&mut self, update: &TrackUpdate<'_>) {
        if !update.accepted {
            return;
        }
        let (at, position) = (update.estimate.at, update.estimate.pose.world_from_capsule.translation.vector);
        if let Some(speed) = self.speeds.get_mut(update.track) {
            speed.push(at.seconds(), position);
        }
        for (track, check) in &mut self.rests {
            if track.as_str() == &**update.track {
                check.push(&position);
            }
        }
        for pair in &mut self.pairs {
            let Some(k) = pair.tracks.iter().position(|name| name.as_str() == &**update.track) else {
                continue;
            };
            pair.take(k, at, position);
        }
    }

    pub(crate) fn expectations(&mut self, asked: &ExpectTable) -> Expectations {
        let speed = |(name, check): (&Name, &mut SpeedCheck)| Some((name.to_string(), check.figures()?));
        let pair = |pair: &Pair| PairDistance { tracks: pair.tracks.clone(), figures: pair.check.figures() };
        let rest = |(track, check): &(String, RestCheck)| TrackRest {
            track: track.clone(),
            figures: check.figures(),
        };
        let mut expected = Expectations {
            speed: self.speeds.iter_mut().filter_map(speed).collect(),
            distance: self.pairs.iter().map(pair).collect(),
            rest: self.rests.iter().map(rest).collect(),
            verdicts: Vec::new(),
        };
        expected.judge(asked, self.speeds.keys());
        expected
    }
}
