//! Magnetometer channels in the world: where each sensor stands, and along which axes it reads.
//!
//! The flux of a magnet at `p` with north along `u` (unit) at channel k (sensor at `s`, axis `a`) is `z_k = a · B(u, s - p)`.
//! Derivatives come from `lumenav-fields` and are taken here with respect to the magnet's position and axis in the world,
//! and from there to the capsule's error `[δp_world, δθ_capsule]` with the magnet at `o` in the capsule's frame:
//!
//! ```text
//! p_magnet = p + R o     δp_magnet = δp - R [o]ₓ δθ
//! u = R x                δu        =     - R [x]ₓ δθ
//! ```

use lumenav_core::pose::skew;
use lumenav_fields::{FieldSource, FluxJacobian};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};

/// One channel: which sensor it belongs to and the axis it reads along, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// Index of the sensor.
    pub sensor: usize,
    /// Unit vector in the world.
    pub axis_world: Vector3<f64>,
    /// The sensor's two other directions, unit vectors in the world: about these an axis may be found turned.
    pub across_world: [Vector3<f64>; 2],
}

/// All channels of an array at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Channels {
    /// Sensor positions in the world, m.
    pub positions_world_m: Vec<Vector3<f64>>,
    /// The channels, in the order of the reading's rows.
    pub channels: Vec<Channel>,
}

/// Where a magnet is and where its north points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagnetPose {
    /// Centre of the magnet in the world, m.
    pub position_world_m: Vector3<f64>,
    /// Unit vector towards its north in the world.
    pub axis_world: Vector3<f64>,
}

impl MagnetPose {
    /// The magnet of a capsule at this pose, mounted at `offset_capsule_m`.
    pub fn of_capsule(world_from_capsule: &Isometry3<f64>, offset_capsule_m: &Vector3<f64>) -> Self {
        Self {
            position_world_m: world_from_capsule.translation.vector
                + world_from_capsule.rotation * offset_capsule_m,
            axis_world: world_from_capsule.rotation * Vector3::x(),
        }
    }
}

/// Buffers for one evaluation; reused, so that a solve allocates nothing after the first.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    offsets_m: Vec<Vector3<f64>>,
    fields: Vec<FluxJacobian>,
    /// Flux per channel, T.
    pub flux_tesla: Vec<f64>,
    /// Derivative by the magnet's position in the world, T/m per channel.
    pub by_position: Vec<Vector3<f64>>,
    /// Derivative by the magnet's axis in the world (for changes perpendicular to it), T per channel.
    pub by_axis: Vec<Vector3<f64>>,
}

impl Prediction {
    /// The magnet's field at each sensor, T in the world.
    pub fn fields(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        self.fields.iter().map(|field| field.flux_tesla)
    }
}

impl Channels {
    /// Number of channels.
    pub fn len(&self) -> usize {
        self.channels.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// Flux of every channel, T.
    pub fn flux(&self, source: &FieldSource, magnet: &MagnetPose, out: &mut Vec<f64>) {
        out.clear();
        let mut last: Option<(usize, Vector3<f64>)> = None;
        for channel in &self.channels {
            let field = match last {
                Some((sensor, field)) if sensor == channel.sensor => field,
                _ => {
                    let offset = self.positions_world_m[channel.sensor] - magnet.position_world_m;
                    source.flux_tesla(&magnet.axis_world, &offset)
                }
            };
            last = Some((channel.sensor, field));
            out.push(channel.axis_world.dot(&field));
        }
    }

    /// Flux and its derivatives by the magnet's position and axis.
    pub fn predict(&self, source: &FieldSource, magnet: &MagnetPose, out: &mut Prediction) {
        out.offsets_m.clear();
        out.offsets_m.extend(self.positions_world_m.iter().map(|s| s - magnet.position_world_m));
        out.fields.resize(self.positions_world_m.len(), FluxJacobian::default());
        // The buffers have equal length by the line above, which is all that can fail here.
        if source.flux_and_jacobian_batch(&magnet.axis_world, &out.offsets_m, &mut out.fields).is_err() {
            unreachable!("equal lengths by construction");
        }
        out.flux_tesla.clear();
        out.by_position.clear();
        out.by_axis.clear();
        for channel in &self.channels {
            let field = &out.fields[channel.sensor];
            let a = &channel.axis_world;
            out.flux_tesla.push(a.dot(&field.flux_tesla));
            // The offset is sensor minus magnet, so its derivative by the magnet's position is minus one.
            out.by_position.push(-field.d_flux_d_offset.tr_mul(a));
            out.by_axis.push(field.d_flux_d_axis.tr_mul(a));
        }
    }

    /// Flux (T) and Jacobian (channels x 6, by `[δp_world, δθ_capsule]`) for a capsule.
    pub fn linearize_capsule(
        &self,
        source: &FieldSource,
        world_from_capsule: &Isometry3<f64>,
        offset_capsule_m: &Vector3<f64>,
        buffers: &mut Prediction,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let magnet = MagnetPose::of_capsule(world_from_capsule, offset_capsule_m);
        self.predict(source, &magnet, buffers);
        let rotation: Matrix3<f64> = world_from_capsule.rotation.to_rotation_matrix().into_inner();
        let move_by_turn = -(rotation * skew(offset_capsule_m));
        let axis_by_turn = -(rotation * skew(&Vector3::x()));
        let mut jacobian = DMatrix::zeros(self.len(), 6);
        for (row, (by_position, by_axis)) in buffers.by_position.iter().zip(&buffers.by_axis).enumerate() {
            let by_turn = move_by_turn.tr_mul(by_position) + axis_by_turn.tr_mul(by_axis);
            for i in 0..3 {
                jacobian[(row, i)] = by_position[i];
                jacobian[(row, 3 + i)] = by_turn[i];
            }
        }
        (DVector::from_column_slice(&buffers.flux_tesla), jacobian)
    }
}
