//! `lumenav layout`: which sensors should one build, and where do they go?

mod compare;
mod evaluate;
mod map;
mod optimize;
mod scene;
mod show;

use super::run::stop_on_ctrl_c;
use crate::args::{LayoutCommand, LayoutOptions, Verbosity};
use crate::threads::Threads;
use anyhow::Context as _;
use lumenav::core::{LayoutElement, Registry};
use lumenav::layouts::evaluate::{Deaths, deaths};
use lumenav::layouts::{Evaluation, LayoutError, Posterior, Summary, posterior};
use lumenav::scenario::ScenarioFile;
use lumenav::{OpenedLayout, open_layout, open_scenario};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Version of the JSON.
const SCHEMA: u32 = 1;

/// Does what is asked of a layout.
pub fn layout(what: &LayoutCommand, registry: &Registry, verbosity: Verbosity) -> anyhow::Result<()> {
    match what {
        LayoutCommand::Evaluate(options) => evaluate::evaluate(&Job::new(options, registry, verbosity)?),
        LayoutCommand::Optimize(options) => optimize::optimize(&Job::new(options, registry, verbosity)?),
        LayoutCommand::Compare(options) => compare::compare(&Job::new(options, registry, verbosity)?),
    }
}

/// What all three need.
struct Job<'a> {
    options: &'a LayoutOptions,
    registry: &'a Registry,
    verbosity: Verbosity,
    file: ScenarioFile,
    threads: Threads,
    stop: Arc<AtomicBool>,
}

impl<'a> Job<'a> {
    fn new(options: &'a LayoutOptions, registry: &'a Registry, verbosity: Verbosity) -> anyhow::Result<Self> {
        Ok(Self {
            file: open_scenario(&options.scenario, &options.set, options.models.as_deref())?,
            threads: Threads::new(options.threads)?,
            stop: stop_on_ctrl_c(),
            options,
            registry,
            verbosity,
        })
    }

    fn open(&self) -> anyhow::Result<OpenedLayout> {
        self.open_of(&self.file)
    }

    fn open_of(&self, file: &ScenarioFile) -> anyhow::Result<OpenedLayout> {
        let opened = open_layout(file, self.registry)?;
        let none = || LayoutError::Impossible(format!("{} has no [layout]", self.options.scenario.display()));
        opened
            .ok_or_else(none)
            .context("give a [layout] with a [layout.workspace], as scenarios/torso-belt-study.toml has one")
    }

    fn out(&self) -> PathBuf {
        let usual = || PathBuf::from("out").join("layout").join(&self.file.scenario.name);
        self.options.out.clone().unwrap_or_else(usual)
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn judge(
        &self,
        opened: &OpenedLayout,
        elements: &[LayoutElement],
    ) -> anyhow::Result<(Evaluation, Judged)> {
        let model = &*opened.model;
        let stopped = || self.is_stopped();
        let evaluation =
            lumenav::layouts::evaluate(model, elements, &opened.workspace, &self.threads, &stopped)?;
        let dead = deaths(model, elements, &opened.workspace, opened.study.dead, &self.threads, &stopped)?;
        let along_path = posterior(model, elements, &opened.readings, &opened.study.motion);
        let judged = Judged {
            summary: evaluation.summary(elements, opened.study.wanted_mm),
            deaths: dead,
            posterior: along_path,
        };
        Ok((evaluation, judged))
    }
}

/// The command, as it stands beside every number.
fn command() -> String {
    let words = std::env::args().skip(1);
    std::iter::once("lumenav".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

/// What is said of one layout.
#[derive(Debug, Serialize)]
struct Judged {
    #[serde(flatten)]
    summary: Summary,
    /// What the death of elements does at worst.
    deaths: Vec<Deaths>,
    /// What a filter can reach along the path, where the workspace is one.
    posterior: Option<Posterior>,
}

/// What was judged, and how.
#[derive(Debug, Serialize)]
struct Setting {
    schema: u32,
    command: String,
    scenario: String,
    sensor: String,
    modality: String,
    /// What is unknown beside position and axis.
    unknown: Vec<String>,
    /// What the judgement takes for granted: noise, errors that nobody has calibrated.
    assumptions: Vec<String>,
    positions: usize,
    directions: usize,
    cost_unit: String,
}

impl Setting {
    fn of(job: &Job<'_>, opened: &OpenedLayout) -> Self {
        let modality = job.file.sensors.iter().find(|s| s.name == opened.sensor).map(|s| s.modality.clone());
        Self {
            schema: SCHEMA,
            command: command(),
            scenario: job.file.scenario.name.clone(),
            sensor: opened.sensor.to_string(),
            modality: modality.unwrap_or_default(),
            unknown: opened.model.parameters().nuisance.iter().map(|n| (*n).to_owned()).collect(),
            assumptions: opened.model.assumptions(),
            positions: opened.workspace.positions_m.len(),
            directions: opened.workspace.directions.len(),
            cost_unit: opened.model.cost_unit().to_owned(),
        }
    }
}
