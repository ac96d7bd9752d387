//! Magnetic localization, set-up A: a magnet in the capsule, magnetometers around the body.
//!
//! The field of a small magnet falls with the third power of the distance, so a handful of magnetometers on a belt or in a
//! table tells where it is and where its north points; the roll about its own axis is unobservable. The crate's rooms:
//!
//! | physics | [`channels`] (flux and derivatives), [`solver`] (maximum likelihood), [`bound`] (Cramér-Rao) |
//! |---|---|
//! | world | [`sensor`] (noise, flaws, ambient field, disturbances, saturation, quantisation) |
//! | design | [`layout`] (what each sensor would say before it is built) |
//! | estimator | [`front_end`] (`pose`, `flux`), [`model`] (raw readings for the filter), [`nuisance`] (what the filter carries beside the pose) |
//! | files | [`mod@array`], [`config`], [`reader`] |
//!
//! Source: B. Moussakhani, T. Ramstad, J. T. Flåm, I. Balasingham, "On localizing a capsule endoscope using magnetic sensors"
//! (2012), with its equations 6 and 10 to 14 corrected. Not here yet: the set-up with sensors in the capsule.

pub mod array;
pub mod bound;
pub mod channels;
pub mod config;
pub mod front_end;
pub mod layout;
pub mod model;
pub mod nuisance;
pub mod reader;
pub mod sensor;
pub mod solver;

use config::{Ambient, Installed, OptionsTable, RealityTable};
use front_end::MagneticFrontEnd;
use layout::ArrayLayout;
use lumenav_core::{Estimator, LayoutModel, Modality, ModalityError, Node, ReadingStream, Sensor, Setup};
use sensor::MagneticSensor;

/// The plugin.
#[derive(Clone, Copy, Debug, Default)]
pub struct Magnetic;

impl Modality for Magnetic {
    fn kind(&self) -> &'static str {
        "magnetic"
    }

    fn about(&self) -> &'static str {
        "a magnet in the capsule, magnetometers around the body (5 degrees of freedom)"
    }

    fn front_ends(&self) -> &'static [&'static str] {
        &["pose", "flux"]
    }

    fn sensor(
        &self,
        installed: &Node,
        reality: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn Sensor>, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table = RealityTable::from_node(reality)?;
        let Some(schedule) = setup.schedule else {
            return Err(installed.error("a simulated sensor needs a [sensor.schedule]").into());
        };
        Ok(Box::new(MagneticSensor::new(setup.sensor.clone(), opened, table, schedule)))
    }

    fn estimator(&self, installed: &Node, options: &Node, setup: &Setup) -> Result<Estimator, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table = OptionsTable::from_node(options)?;
        if table.ambient == Ambient::Reference && !opened.array.reference_tells_all() {
            let message = format!(
                "the reference sensors of array `{}` do not tell all three components of a field; give its file a [[sensor]] of three axes with `reference = true`",
                opened.array.name
            );
            return Err(options.error_at("ambient", &message).into());
        }
        Ok(Estimator::of_front_end(MagneticFrontEnd::new(setup.sensor.clone(), &opened, &table)))
    }

    fn layout(
        &self,
        installed: &Node,
        options: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn LayoutModel>, ModalityError> {
        Ok(Box::new(ArrayLayout::from_nodes(installed, options, setup)?))
    }

    fn reader(&self, installed: &Node, files: &Node, setup: &Setup) -> Result<ReadingStream, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        reader::open(&opened, files, setup)
    }
}
