//! The world side: true times of flight, noise, lost readings.

#![expect(clippy::disallowed_types, reason = "world side: a sensor observes the truth")]

use crate::Installed;
use crate::physics::time_of_flight_s;
use lumenav_core::{
    Frame, ModalityError, Name, Observation, Primitive, RandomStreams, Reading, Schedule, Sensor, SimTime,
    TruthView,
};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use std::collections::BTreeMap;

/// All beacons at once: their pulses are told apart by their codes.
pub struct BeaconSensor {
    name: Name,
    installed: Installed,
    speed_ratio: f64,
    schedule: Schedule,
    sequence: u64,
}

impl BeaconSensor {
    /// A sensor with the world's own speed of sound.
    pub fn new(name: Name, installed: Installed, speed_ratio: f64, schedule: Schedule) -> Self {
        Self { name, installed, speed_ratio, schedule, sequence: 0 }
    }
}

impl Sensor for BeaconSensor {
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
        if random.stream("loss", sequence).random::<f64>() < self.schedule.loss.0 {
            return Ok(None);
        }
        let position_m = truth.capsule(at).world_from_capsule.translation.vector;
        let mut noise = random.stream("noise", sequence);
        let mut measured = |beacon_m| {
            let error: f64 = StandardNormal.sample(&mut noise);
            time_of_flight_s(&position_m, beacon_m, self.speed_ratio) + self.installed.sigma_s * error
        };
        let times_s: Vec<f64> = self.installed.beacons_world_m.iter().map(&mut measured).collect();
        let reading = Reading {
            sensor: self.name.clone(),
            sequence,
            interval: (at, at),
            arrival: self.schedule.arrival(at),
            known_poses: BTreeMap::new(),
            payload: Frame::of_values(self.installed.schema.clone(), times_s)?,
        };
        Ok(Some(Observation { reading, labels: None }))
    }

    fn scene(&self, out: &mut Vec<Primitive>) {
        out.push(Primitive::Points {
            path: "beacons".to_owned(),
            positions_world_m: self
                .installed
                .beacons_world_m
                .iter()
                .map(|b| [0, 1, 2].map(|i| b[i] as f32))
                .collect(),
            rgba: vec![0x3388_ffff],
            radius_m: 0.004,
        });
    }
}
