//! What a filter carries of an array beside the capsule's motion: strength, ambient field, and each channel's offset, gain and axis.
//!
//! With s the strength, b the ambient field, g, τ, β a channel's gain error, axis error and offset, B the magnet's field at the sensor:
//!
//! ```text
//! z = (1 + g) a'·(s B + b) + β          a' = Exp(τ₁ c₁ + τ₂ c₂) a        (c₁, c₂: the sensor's two other directions)
//! ∂z/∂s = (1 + g) a'·B                  ∂z/∂b = (1 + g) a'               ∂z/∂g = a'·(s B + b)      ∂z/∂β = 1
//! ∂z/∂τᵢ = (1 + g) (J_l(τ) cᵢ × a')·(s B + b)
//! ```
//!
//! Each is a block of the filter's state with a prior and a random walk, named `<sensor>.<what>`. A moving magnet tells them apart: the
//! pose changes from reading to reading and they do not.

use crate::channels::{Channel, Channels};
use lumenav_core::pose::{exp_so3, right_jacobian_so3};
use lumenav_core::{BlockSpec, ModalityError, Name, Part, StateView};
use nalgebra::{DMatrix, DVector, Vector3};
use std::borrow::Cow;

/// Prior standard deviation and random walk (per square root of a second) of one kind of unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Standard deviation at the start.
    pub sigma: f64,
    /// Random walk, unit per square root of a second; 0 for a constant.
    pub walk: f64,
}

/// Which unknowns a track estimates, and how well they are known before; `None` for what it takes as installed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Unknowns {
    /// Strength over the installed one.
    pub strength: Option<Spread>,
    /// Uniform ambient field in the world, T.
    pub ambient_tesla: Option<Spread>,
    /// Offset of each channel, T.
    pub bias_tesla: Option<Spread>,
    /// Relative gain error of each channel.
    pub gain: Option<Spread>,
    /// Turns of each channel's axis, rad.
    pub axis_rad: Option<Spread>,
}

/// The blocks of one sensor.
#[derive(Clone, Debug, Default)]
pub struct Nuisance {
    specs: Vec<BlockSpec>,
    strength: Option<Name>,
    ambient: Option<Name>,
    bias: Option<Name>,
    gain: Option<Name>,
    axis: Option<Name>,
}

/// The unknowns at one state.
struct Values<'s> {
    strength: f64,
    ambient_tesla: Vector3<f64>,
    bias_tesla: Option<&'s [f64]>,
    gain: Option<&'s [f64]>,
    axis_rad: Option<&'s [f64]>,
}

/// Flux of every channel with its derivatives.
#[derive(Clone, Debug)]
pub struct Explained {
    /// Flux, T.
    pub flux_tesla: DVector<f64>,
    /// By `[δp_world, δθ_capsule]`.
    pub by_pose: DMatrix<f64>,
    /// By each block that is estimated.
    pub by_block: Vec<(Part, DMatrix<f64>)>,
}

impl Nuisance {
    /// The blocks of `sensor` with so many channels.
    pub fn new(sensor: &str, channels: usize, unknowns: &Unknowns) -> Self {
        let mut made = Self::default();
        let mut block = |what: &str, width: usize, start: f64, spread: Option<Spread>| {
            let spread = spread?;
            let name = Name::from(format!("{sensor}.{what}"));
            made.specs.push(BlockSpec {
                name: name.clone(),
                initial: DVector::from_element(width, start),
                initial_sigma: DVector::from_element(width, spread.sigma),
                random_walk: DVector::from_element(width, spread.walk),
            });
            Some(name)
        };
        let strength = block("strength", 1, 1.0, unknowns.strength);
        let ambient = block("ambient_tesla", 3, 0.0, unknowns.ambient_tesla);
        let bias = block("bias_tesla", channels, 0.0, unknowns.bias_tesla);
        let gain = block("gain", channels, 0.0, unknowns.gain);
        let axis = block("axis_rad", 2 * channels, 0.0, unknowns.axis_rad);
        Self { strength, ambient, bias, gain, axis, ..made }
    }

    /// What the filter is asked to carry.
    pub fn specs(&self) -> &[BlockSpec] {
        &self.specs
    }

    fn values<'s>(&self, at: &'s dyn StateView, channels: usize) -> Result<Values<'s>, ModalityError> {
        let of = |name: &Option<Name>, width: usize| -> Result<Option<&'s [f64]>, ModalityError> {
            let Some(name) = name else { return Ok(None) };
            let block = at.block(name).filter(|block| block.len() == width);
            let block = block.ok_or_else(|| ModalityError::MissingBlock(name.to_string()))?;
            Ok(Some(block.data.into_slice()))
        };
        Ok(Values {
            strength: of(&self.strength, 1)?.map_or(1.0, |s| s[0]),
            ambient_tesla: of(&self.ambient, 3)?.map_or_else(Vector3::zeros, Vector3::from_column_slice),
            bias_tesla: of(&self.bias, channels)?,
            gain: of(&self.gain, channels)?,
            axis_rad: of(&self.axis, 2 * channels)?,
        })
    }

    /// Flux and derivatives at a state. `linearize` gives flux and its derivative by the pose of channels at a strength of 1; `fields` the
    /// magnet's field at each sensor.
    ///
    /// # Errors
    /// [`ModalityError::MissingBlock`] where the state lacks a block.
    pub fn explain(
        &self,
        channels: &Channels,
        at: &dyn StateView,
        linearize: impl FnOnce(&Channels) -> (DVector<f64>, DMatrix<f64>, Vec<Vector3<f64>>),
    ) -> Result<Explained, ModalityError> {
        let count = channels.len();
        let values = self.values(at, count)?;
        let turned = turned(channels, values.axis_rad);
        let (mut flux, mut by_pose, fields) = linearize(&turned);
        if self.specs.is_empty() {
            return Ok(Explained { flux_tesla: flux, by_pose, by_block: Vec::new() });
        }
        let mut columns = Columns::new(self, count);
        for k in 0..count {
            let channel = &turned.channels[k];
            let gain = 1.0 + values.gain.map_or(0.0, |g| g[k]);
            let of_magnet = flux[k];
            let whole = fields[channel.sensor] * values.strength + values.ambient_tesla;
            let seen = channel.axis_world.dot(&whole);
            columns.strength[k] = gain * of_magnet;
            columns.set_ambient(k, &(channel.axis_world * gain));
            columns.set_gain(k, seen);
            if let Some(turns) = values.axis_rad {
                let nominal = &channels.channels[k];
                let turn = turn_of(nominal, &turns[2 * k..2 * k + 2]);
                let left = right_jacobian_so3(&-turn);
                for (i, across) in nominal.across_world.iter().enumerate() {
                    let slope = (left * across).cross(&channel.axis_world).dot(&whole);
                    columns.axis[(k, 2 * k + i)] = gain * slope;
                }
            }
            flux[k] = gain * seen + values.bias_tesla.map_or(0.0, |b| b[k]);
            by_pose.row_mut(k).scale_mut(gain * values.strength);
        }
        Ok(Explained { flux_tesla: flux, by_pose, by_block: columns.parts(self) })
    }
}

/// The channels with their axes as the state believes them; a copy only where it believes anything.
fn turned<'c>(channels: &'c Channels, axis_rad: Option<&[f64]>) -> Cow<'c, Channels> {
    let Some(turns) = axis_rad else { return Cow::Borrowed(channels) };
    let mut turned = channels.clone();
    for (channel, turn) in turned.channels.iter_mut().zip(turns.chunks_exact(2)) {
        channel.axis_world = exp_so3(&turn_of(channel, turn)) * channel.axis_world;
    }
    Cow::Owned(turned)
}

/// The turn of a channel's axis in the world.
fn turn_of(channel: &Channel, turn: &[f64]) -> Vector3<f64> {
    channel.across_world[0] * turn[0] + channel.across_world[1] * turn[1]
}

/// Derivatives by the blocks; those that are not estimated have no columns.
struct Columns {
    strength: DVector<f64>,
    ambient: DMatrix<f64>,
    gain: DMatrix<f64>,
    axis: DMatrix<f64>,
}

impl Columns {
    fn new(nuisance: &Nuisance, count: usize) -> Self {
        let sized = |name: &Option<Name>, width: usize| {
            if name.is_some() { DMatrix::zeros(count, width) } else { DMatrix::zeros(0, 0) }
        };
        Self {
            strength: DVector::zeros(count),
            ambient: sized(&nuisance.ambient, 3),
            gain: sized(&nuisance.gain, count),
            axis: sized(&nuisance.axis, 2 * count),
        }
    }

    fn set_ambient(&mut self, k: usize, axis: &Vector3<f64>) {
        if !self.ambient.is_empty() {
            self.ambient.row_mut(k).tr_copy_from(axis);
        }
    }

    fn set_gain(&mut self, k: usize, seen: f64) {
        if !self.gain.is_empty() {
            self.gain[(k, k)] = seen;
        }
    }

    fn parts(self, nuisance: &Nuisance) -> Vec<(Part, DMatrix<f64>)> {
        let count = self.strength.len();
        let strength = DMatrix::from_column_slice(count, 1, self.strength.as_slice());
        let bias = || DMatrix::identity(count, count);
        let all = [
            (&nuisance.strength, strength),
            (&nuisance.ambient, self.ambient),
            (&nuisance.bias, nuisance.bias.as_ref().map_or_else(|| DMatrix::zeros(0, 0), |_| bias())),
            (&nuisance.gain, self.gain),
            (&nuisance.axis, self.axis),
        ];
        let named = |(name, columns): (&Option<Name>, DMatrix<f64>)| {
            name.as_ref().map(|name| (Part::Block(name.clone()), columns))
        };
        all.into_iter().filter_map(named).collect()
    }
}
