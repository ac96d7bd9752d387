//! The simulated array: truth in, flux out.
//!
//! `reading = clip(quantise(gain · (a'·(B(magnet) + B(ambient) + B(earth) + B(disturbances)) - a₀'·B₀(earth)) + bias + noise))` with a' the
//! true axis, the sensor at its true place, and the Earth's field B₀ in which the array was zeroed, with its axes a₀' along the world's. A
//! sphere of iron of radius r in a field B has the moment `4π r³ B/μ₀` (permeability without bound: Jackson, section 5.11). Gains, axes, biases and misplacements are drawn once, from the streams `gain`, `axis`, `bias`
//! and `placement`; the noise of reading n from `(noise, n)`, whether it is lost from `(loss, n)`: losses shift no noise.

#![expect(clippy::disallowed_types, reason = "world side: a sensor observes the truth")]

use crate::channels::{Channels, MagnetPose};
use crate::config::{Installed, RealityTable};
use lumenav_core::pose::{exp_so3, tangent_basis};
use lumenav_core::{
    Frame, ModalityError, Name, Observation, Primitive, RandomStreams, Reading, Schedule, Schema, Sensor,
    SimTime, TruthView,
};
use lumenav_fields::{FieldSource, dipole};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Channel errors drawn once per run.
struct Flaws {
    gain: Vec<f64>,
    bias_tesla: Vec<f64>,
    /// Small rotation per channel, in the array's frame.
    axis_turn: Vec<UnitQuaternion<f64>>,
    /// Per sensor, in the array's frame, m.
    misplacement_m: Vec<Vector3<f64>>,
}

/// A simulated magnetometer array.
pub struct MagneticSensor {
    name: Name,
    installed: Installed,
    reality: RealityTable,
    schedule: Schedule,
    source: FieldSource,
    schema: Arc<Schema>,
    flaws: Option<Flaws>,
    sequence: u64,
    /// Last true channels and flux, for the picture.
    last: Option<(Channels, Vec<f64>)>,
}

impl MagneticSensor {
    /// Builds the sensor; its flaws are drawn at the first reading.
    pub fn new(name: Name, installed: Installed, reality: RealityTable, schedule: Schedule) -> Self {
        let mut source = installed.magnet.source(reality.law);
        let factor = 1.0 + reality.strength_error.0;
        source = match source {
            FieldSource::Dipole { strength_t_m3 } => {
                FieldSource::Dipole { strength_t_m3: strength_t_m3 * factor }
            }
            FieldSource::Cylinder(c) => {
                // A strength error of -100 % or less leaves no magnet; the config's reader refuses it.
                lumenav_fields::Cylinder::new(c.radius_m(), c.half_length_m(), c.remanence_tesla() * factor)
                    .map_or(source, FieldSource::Cylinder)
            }
        };
        let schema = flux_schema(installed.array.labels());
        Self { name, installed, reality, schedule, source, schema, flaws: None, sequence: 0, last: None }
    }

    fn draw_flaws(&self, random: &RandomStreams) -> Flaws {
        let labels = self.installed.array.labels().len();
        let sensors = self.installed.array.sensors.len();
        let normals = |purpose: &str, count: usize| -> Vec<f64> {
            let mut stream = random.stream(purpose, 0);
            (0..count).map(|_| stream.sample(StandardNormal)).collect()
        };
        let nominal = self.installed.array.channels(&Isometry3::identity());
        let turns = normals("axis", 2 * labels);
        let sigma_rad = self.reality.axis_sigma_deg.0.to_radians();
        let axis_turn = nominal
            .channels
            .iter()
            .zip(turns.chunks_exact(2))
            .map(|(channel, t)| {
                let (e1, e2) = tangent_basis(&channel.axis_world);
                exp_so3(&((e1 * t[0] + e2 * t[1]) * sigma_rad))
            })
            .collect();
        let placement = normals("placement", 3 * sensors);
        let sigma_m = self.reality.placement_sigma_mm.0 * 1e-3;
        Flaws {
            gain: normals("gain", labels).iter().map(|g| 1.0 + g * self.reality.gain_sigma.0).collect(),
            bias_tesla: normals("bias", labels).iter().map(|b| b * self.reality.bias_sigma_tesla.0).collect(),
            axis_turn,
            misplacement_m: placement
                .chunks_exact(3)
                .map(|p| Vector3::new(p[0], p[1], p[2]) * sigma_m)
                .collect(),
        }
    }

    /// The channels as they truly are.
    fn true_channels(&self, flaws: &Flaws, world_from_array: &Isometry3<f64>) -> Channels {
        let mut channels = self.installed.array.channels(&Isometry3::identity());
        for (position, error) in channels.positions_world_m.iter_mut().zip(&flaws.misplacement_m) {
            *position = (world_from_array * nalgebra::Point3::from(*position + error)).coords;
        }
        for (channel, turn) in channels.channels.iter_mut().zip(&flaws.axis_turn) {
            channel.axis_world = world_from_array.rotation * (turn * channel.axis_world);
        }
        channels
    }

    /// The Earth's field as it lies now, T in the world.
    fn earth_tesla(&self, at: SimTime) -> Vector3<f64> {
        let mut field = Vector3::from(self.reality.earth_tesla.map(|v| v.0));
        for turn in &self.reality.turn {
            let done = ((at.seconds() - turn.start_s.0) / (turn.end_s.0 - turn.start_s.0)).clamp(0.0, 1.0);
            let axis = Vector3::from(turn.axis.map(|v| v.0)).normalize();
            field = exp_so3(&(axis * (-done * turn.angle_deg.0.to_radians()))) * field;
        }
        field
    }

    /// Moments of what comes near, each with its place; `far` is the uniform field.
    fn disturbances(
        &self,
        at: SimTime,
        far: &Vector3<f64>,
        magnet: &MagnetPose,
    ) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let now_s = at.seconds();
        let here = self.reality.disturbance.iter().filter(|d| now_s >= d.start_s.0 && now_s < d.end_s.0);
        here.map(|d| {
            let place = Vector3::from(d.position_mm.map(|v| v.0)) * 1e-3;
            let remanent = d.moment_a_m2.map(|m| Vector3::from(m.map(|v| v.0)));
            let moment = remanent.unwrap_or_else(|| {
                let radius_m = d.sphere_radius_mm.map_or(0.0, |r| r.0 * 1e-3);
                let offset = place - magnet.position_world_m;
                let field = far + self.source.flux_tesla(&magnet.axis_world, &offset);
                field * (radius_m.powi(3) / dipole::strength_from_moment_t_m3(1.0))
            });
            (place, moment)
        })
        .collect()
    }

    /// Rounds, then clips: a clipped reading is the limit itself, which is how an estimator knows it.
    fn digitise(&self, value: f64) -> f64 {
        let rounded = self.installed.step_tesla().map_or(value, |step| (value / step).round() * step);
        self.installed.limit_tesla().map_or(rounded, |limit| rounded.clamp(-limit, limit))
    }
}

/// Field of everything but the magnet that is seen, T in the world.
fn surroundings(
    position_m: &Vector3<f64>,
    far: &Vector3<f64>,
    near: &[(Vector3<f64>, Vector3<f64>)],
) -> Vector3<f64> {
    let mut field = *far;
    for (place, moment) in near {
        if let Some(axis) = moment.try_normalize(0.0) {
            let strength = dipole::strength_from_moment_t_m3(moment.norm());
            field += dipole::flux_tesla(strength, &axis, &(position_m - place));
        }
    }
    field
}

/// Schema of a reading: one channel per axis, flux density in T.
pub fn flux_schema(labels: Vec<String>) -> Arc<Schema> {
    Schema::channels("magnetometers/1", "flux_tesla", labels)
}

impl Sensor for MagneticSensor {
    fn next_due(&self) -> SimTime {
        self.schedule.due(self.sequence)
    }

    fn skip_to(&mut self, at: SimTime) {
        self.sequence = self.schedule.first_from(at);
    }

    fn observe(
        &mut self,
        truth: &dyn TruthView,
        at: SimTime,
        random: &RandomStreams,
    ) -> Result<Option<Observation>, ModalityError> {
        let sequence = self.sequence;
        self.sequence += 1;
        let loss = self.schedule.loss.0;
        if loss > 0.0 && random.stream("loss", sequence).random::<f64>() < loss {
            return Ok(None);
        }
        let mut stream = random.stream("noise", sequence);
        let flaws = match self.flaws.take() {
            Some(flaws) => flaws,
            None => self.draw_flaws(random),
        };
        let worn = self.installed.table.worn_on.as_deref();
        let known = |pose: Option<Isometry3<f64>>, frame: &str| {
            pose.ok_or_else(|| ModalityError::Reading(format!("the scenario has no moving frame `{frame}`")))
        };
        let [world_from_array, told] = match worn {
            Some(frame) => {
                [known(truth.frame(frame, at), frame)?, known(truth.told_frame(frame, at), frame)?]
            }
            None => [Isometry3::identity(); 2],
        };
        let capsule = truth.capsule(at).world_from_capsule;
        let magnet = MagnetPose::of_capsule(&capsule, &self.installed.magnet.offset_capsule_m);
        let channels = self.true_channels(&flaws, &world_from_array);
        let mut flux = Vec::with_capacity(channels.len());
        channels.flux(&self.source, &magnet, &mut flux);
        let sigma = self.installed.noise_tesla();
        let far = Vector3::from(self.reality.ambient_tesla.map(|v| v.0)) + self.earth_tesla(at);
        let near = self.disturbances(at, &far, &magnet);
        let zeroed = Vector3::from(self.reality.earth_tesla.map(|v| v.0));
        for (k, value) in flux.iter_mut().enumerate() {
            let channel = &channels.channels[k];
            let around = surroundings(&channels.positions_world_m[channel.sensor], &far, &near);
            let noise: f64 = stream.sample(StandardNormal);
            // The axis as it lay when the array was zeroed: its own frame was the world's.
            let axis_then = world_from_array.rotation.inverse() * channel.axis_world;
            let seen = flaws.gain[k] * (*value + channel.axis_world.dot(&around) - axis_then.dot(&zeroed));
            *value = self.digitise(seen + flaws.bias_tesla[k] + sigma * noise);
        }
        let mut known_poses = BTreeMap::new();
        if worn.is_some() {
            known_poses.insert("array".to_owned(), told);
        }
        let reading = Reading {
            sensor: self.name.clone(),
            sequence,
            interval: (at, at),
            arrival: self.schedule.arrival(at),
            known_poses,
            payload: Frame::of_values(self.schema.clone(), flux.clone())?,
        };
        self.last = Some((channels, flux));
        self.flaws = Some(flaws);
        Ok(Some(Observation { reading, labels: None }))
    }

    fn scene(&self, out: &mut Vec<Primitive>) {
        let Some((channels, flux)) = &self.last else { return };
        let mut field = vec![Vector3::zeros(); channels.positions_world_m.len()];
        for (channel, value) in channels.channels.iter().zip(flux) {
            field[channel.sensor] += channel.axis_world * *value;
        }
        let to_f32 = |v: &Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        // Length by the logarithm of the flux: 10 mm per decade above 10 nT, so that near and far sensors both show.
        let arrow = |b: &Vector3<f64>| {
            let length = 0.01 * (b.norm() / 1e-8).max(1.0).log10();
            b.try_normalize(0.0).map_or([0.0; 3], |unit| to_f32(&(unit * length)))
        };
        out.push(Primitive::Points {
            path: "magnetometers".into(),
            positions_world_m: channels.positions_world_m.iter().map(to_f32).collect(),
            rgba: vec![0x4477_AAFF],
            radius_m: 0.006,
        });
        out.push(Primitive::Arrows {
            path: "field".into(),
            origins_world_m: channels.positions_world_m.iter().map(to_f32).collect(),
            vectors_m: field.iter().map(arrow).collect(),
            rgba: vec![0x66CC_EEFF],
        });
    }
}
