//! PET-marker tracking: three or more positron emitters in the capsule's cover, coincidence detectors around the body.
//!
//! Each annihilation sends two 511 keV photons apart at almost 180 degrees; two crystals that fire together give one *line of
//! response* (LoR). A window of 50 ms holds a few hundred lines, most of them true, some scattered or random, none labelled. The
//! trackers turn one window into the markers' positions and with them the capsule's pose in six degrees of freedom. The rooms:
//!
//! | physics | [`scanner`] (blocks, crystals, index ↔ position), [`markers`], [`simulation`] (from decays to lines) |
//! |---|---|
//! | world | [`sensor`] |
//! | estimators | [`mod@line`], [`tracking`] (`fcm`, `rigid`, `mixture`), [`front_end`], [`model`] (lines as they are, for the filter) |
//! | before an exam | [`planning`] (dose, activity, expected accuracy), [`layout`] (blocks of a scanner, judged before they are built) |
//! | files | [`config`], [`payload`], [`reader`] |
//!
//! Source: T. D. Than, *Localization and tracking of robotic endoscopic capsules using multiple positron emission markers*, PhD
//! thesis, University of Wollongong, 2015 (`than2015`), with its slips corrected where a file's head says so.

pub mod config;
pub mod coverage;
pub mod front_end;
pub mod layout;
pub mod line;
pub mod markers;
pub mod model;
pub mod payload;
pub mod planning;
mod rail;
pub mod reader;
pub mod scanner;
pub mod sensor;
pub mod simulation;
pub mod tracking;

pub use line::Line;
pub use markers::{Marker, MarkerSet};
pub use scanner::{CrystalIndex, Scanner};

use config::{Installed, OptionsTable, REALITY_SOURCES, RealityTable};
use layout::ScannerLayout;
use lumenav_core::{Estimator, LayoutModel, Modality, ModalityError, Node, ReadingStream, Sensor, Setup};
use sensor::PetSensor;
use simulation::TableStore;

/// The plugin. Simulated scanners that it builds share the tables of [`simulation::Mode::Tabulated`].
#[derive(Clone, Debug, Default)]
pub struct Pet {
    tables: TableStore,
}

impl Modality for Pet {
    fn kind(&self) -> &'static str {
        "pet"
    }

    fn about(&self) -> &'static str {
        "positron markers in the capsule, coincidence detectors around the body (6 degrees of freedom)"
    }

    fn front_ends(&self) -> &'static [&'static str] {
        &["mixture", "rigid", "fcm", "lines", "points"]
    }

    fn sensor(
        &self,
        installed: &Node,
        reality: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn Sensor>, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table: RealityTable = reality.parse_sourced(&REALITY_SOURCES)?;
        let Some(schedule) = setup.schedule else {
            return Err(installed.error("a simulated sensor needs a [sensor.schedule]").into());
        };
        Ok(Box::new(PetSensor::new(setup, opened, table, reality, schedule)?.sharing(self.tables.clone())))
    }

    fn estimator(&self, installed: &Node, options: &Node, setup: &Setup) -> Result<Estimator, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table = OptionsTable::from_node(options)?;
        front_end::build(&opened, &table, setup)
    }

    fn layout(
        &self,
        installed: &Node,
        options: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn LayoutModel>, ModalityError> {
        Ok(Box::new(ScannerLayout::from_nodes(installed, options, setup)?))
    }

    fn reader(&self, installed: &Node, files: &Node, setup: &Setup) -> Result<ReadingStream, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        reader::open(&opened.scanner, files, setup)
    }
}
