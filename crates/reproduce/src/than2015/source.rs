//! Lines for a reproduction: scanner, body and markers of than2015 in the simulator, and a tally of what the lines are.
//!
//! The tally reads labels, which only the world knows; the lines that estimators get have none.

use super::motion::Motion;
use super::set_up;
use crate::ReproduceError;
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::{ModelFolder, Node, RandomStreams};
use lumenav_pet::simulation::{
    Isotope, LabelledLine, Mode, Origin, Scintillator, Settings, Simulator, SourceMarker,
};
use lumenav_pet::tracking::SourceNoise;
use lumenav_pet::{Line, MarkerSet, Scanner};
use nalgebra::Vector3;

/// Lines that a pilot run counts, to set the activity: one per cent of statistical error.
const PILOT_LINES: f64 = 10_000.0;
/// The seed of pilot runs: no reported run's.
const PILOT_SEED: u64 = 0;

/// A scanner, a body in it, and markers as they really are.
#[derive(Clone, Debug)]
pub struct Set {
    /// The scanner.
    pub scanner: Scanner,
    /// Its crystals' material.
    pub scintillator: Scintillator,
    /// The body.
    pub phantom: Phantom,
    /// The markers as estimators know them.
    pub markers: MarkerSet,
    /// Spread of their annihilations, by isotope and core.
    pub source_noise: SourceNoise,
    /// The markers as they are.
    pub true_markers: Vec<SourceMarker>,
    /// How lines are made.
    pub settings: Settings,
}

impl Set {
    /// The markers of the simulations in a scanner and a water cylinder.
    ///
    /// # Errors
    /// A model file that is not there or not right.
    pub fn than2015(models: &ModelFolder, scanner: &str, phantom: &str) -> Result<Self, ReproduceError> {
        let markers = set_up::markers(models)?;
        let phantom = set_up::phantom(models, phantom)?;
        Self::new(models, scanner, phantom, markers)
    }

    /// These markers, exactly where they are said to be, in a scanner and a body.
    ///
    /// # Errors
    /// A model file that is not there or not right.
    pub fn new(
        models: &ModelFolder,
        scanner: &str,
        phantom: Phantom,
        markers: MarkerSet,
    ) -> Result<Self, ReproduceError> {
        let scanner = set_up::scanner(models, scanner)?;
        let open =
            |kind: &str, name: &str| Node::open(&models.root().join(kind).join(format!("{name}.toml")));
        let scintillator = Scintillator::from_node(&open("scintillators", &scanner.detection.scintillator)?)?;
        let scanner = scanner.with_interaction_depth(&scintillator);
        let mut true_markers = Vec::new();
        for marker in &markers.markers {
            true_markers.push(SourceMarker {
                position_capsule_m: marker.position_capsule_m,
                activity_bq: marker.activity_bq,
                isotope: Isotope::from_node(&open("isotopes", &marker.isotope)?)?,
                core_diameter_m: marker.core_diameter_m,
                shell: None,
            });
        }
        let settings = Settings { mode: Mode::Forced, ..Settings::default() };
        let source_noise = SourceNoise::of_markers(&true_markers);
        Ok(Self { scanner, scintillator, phantom, markers, source_noise, true_markers, settings })
    }

    /// Where the markers really are, capsule frame, m: apex, base, base.
    ///
    /// # Errors
    /// Not three markers.
    pub fn markers_capsule_m(&self) -> Result<[Vector3<f64>; 3], ReproduceError> {
        let all: Vec<Vector3<f64>> = self.true_markers.iter().map(|m| m.position_capsule_m).collect();
        let count = all.len();
        all.try_into().map_err(|_| ReproduceError::of_part("markers")(format!("{count}, expected three")))
    }

    /// Multiplies the activity of all markers.
    pub fn scale_activity(&mut self, factor: f64) {
        for marker in &mut self.true_markers {
            marker.activity_bq *= factor;
        }
    }

    /// The factor on the activity with which the mean count of a path's windows is `lines`, from a pilot run of windows spread
    /// over the path. `share` of the usual number of windows.
    ///
    /// # Errors
    /// A pilot run without lines.
    pub fn activity_factor(
        &self,
        motion: &dyn Motion,
        lines: f64,
        window_s: f64,
        share: f64,
    ) -> Result<f64, ReproduceError> {
        let all = motion.windows(window_s);
        let count = ((share * PILOT_LINES / lines).ceil() as usize).clamp(1, all);
        let mut source = Source::new(self, PILOT_SEED, "pilot");
        let mut window = Vec::new();
        for k in 0..count {
            let sequence = (2 * k + 1) * all / (2 * count);
            window.clear();
            source.window(motion, sequence as f64 * window_s, window_s, sequence, &mut window);
        }
        let counted = source.tally().lines as f64 / count as f64;
        if counted > 0.0 {
            Ok(lines / counted)
        } else {
            Err(ReproduceError::of_part("pilot run")("no line at all"))
        }
    }
}

/// What lines are, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// All of them.
    pub lines: u64,
    /// Both photons of one annihilation, neither scattered in the body.
    pub true_lines: u64,
    /// Lines of a 511 keV photon with a prompt gamma of the same decay.
    pub with_partner: u64,
}

/// Makes the windows of one run.
pub struct Source {
    simulator: Simulator,
    random: RandomStreams,
    buffer: Vec<LabelledLine>,
    tally: Tally,
}

impl Source {
    /// How lines are made, in words.
    pub const MODE: &'static str = "forced: every decay's photons aimed at blocks, unbiased";

    /// Windows from the streams of this seed and name.
    pub fn new(set: &Set, seed: u64, name: &str) -> Self {
        let simulator = Simulator::new(
            set.scanner.clone(),
            set.scintillator.clone(),
            Some(set.phantom.clone()),
            set.true_markers.clone(),
            set.settings,
        );
        Self {
            simulator,
            random: RandomStreams::new(seed, 0, name),
            buffer: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// Appends the lines of a window.
    pub fn window(
        &mut self,
        motion: &dyn Motion,
        start_s: f64,
        duration_s: f64,
        sequence: usize,
        out: &mut Vec<Line>,
    ) {
        let path = |t_s: f64| motion.world_from_capsule(t_s);
        self.simulator.window(&path, start_s, duration_s, &self.random, sequence as u64, &mut self.buffer);
        for labelled in &self.buffer {
            self.tally.lines += 1;
            self.tally.true_lines += u64::from(labelled.label.origin == Origin::True);
            self.tally.with_partner += u64::from(labelled.label.origin == Origin::Prompt);
            out.push(labelled.line);
        }
    }

    /// What the lines so far were.
    pub fn tally(&self) -> Tally {
        self.tally
    }
}
