//! Snapshots: the exact state of an engine as bytes, from which a run continues bit by bit.
//!
//! Little-endian: magic `LNVE`, version (u32), a fingerprint of configuration, bodies, joints and tract (u64), then the state in the
//! order of [`Engine::snapshot`]. The motility is not in it: it is a pure function of time, and is replayed on restoring
//! (0.1 s for eight hours). Nor are rapier's contacts with what is rigid: of a capsule that leans on several things at once, or on a plate, a run goes on within
//! rounding, not bit by bit. Neither is the patient, another pure function of time. A snapshot belongs to an engine built from the same scenario; the fingerprint tells others.

use super::mover::Mover;
use super::sleep::Sleep;
use super::system::Twist;
use super::wall::RINGS;
use super::{CAPSULE, Engine, EngineError};
use lumenav_core::SimTime;
use std::fmt::{self, Write as _};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

const MAGIC: &[u8; 4] = b"LNVE";
const VERSION: u32 = 4;
/// Stands for "awake" where a sleeper's time would stand, s.
const AWAKE_S: f64 = -1.0;
/// Stands for no place where one would stand, m.
const NOWHERE_M: f64 = -1.0;

struct Writer(Vec<u8>);

impl Writer {
    fn whole(&mut self, value: u64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn number(&mut self, value: f64) {
        self.whole(value.to_bits());
    }

    fn vector(&mut self, value: &Vector3<f64>) {
        for v in value.iter() {
            self.number(*v);
        }
    }

    fn mover(&mut self, mover: &Mover, pose: &Isometry3<f64>, twist: &Twist) {
        self.vector(&pose.translation.vector);
        for q in pose.rotation.coords.iter() {
            self.number(*q);
        }
        self.vector(&twist.linear);
        self.vector(&twist.angular);
        self.number(mover.station.arc_length_m);
        self.number(mover.offset_m);
        for foot_m in mover.contacts.feet_m() {
            self.number(*foot_m);
        }
        self.whole(mover.segment_index as u64);
        self.whole(u64::from(mover.valve.is_some_and(|valve| valve.passed)));
        self.whole(u64::from(mover.left));
    }
}

/// The state of one mover.
struct Moved {
    pose: Isometry3<f64>,
    twist: Twist,
    arc_length_m: f64,
    offset_m: f64,
    feet_m: [f64; RINGS],
    segment_index: usize,
    passed: bool,
    left: bool,
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], EngineError> {
        let Some((first, rest)) = self.0.split_first_chunk::<N>() else {
            return Err(EngineError::Snapshot { reason: "cut short" });
        };
        self.0 = rest;
        Ok(*first)
    }

    fn whole(&mut self) -> Result<u64, EngineError> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }

    fn flag(&mut self) -> Result<bool, EngineError> {
        Ok(self.whole()? != 0)
    }

    fn number(&mut self) -> Result<f64, EngineError> {
        let value = f64::from_bits(self.whole()?);
        if value.is_finite() {
            Ok(value)
        } else {
            Err(EngineError::Snapshot { reason: "a number is not finite" })
        }
    }

    fn vector(&mut self) -> Result<Vector3<f64>, EngineError> {
        Ok(Vector3::new(self.number()?, self.number()?, self.number()?))
    }

    fn mover(&mut self) -> Result<Moved, EngineError> {
        let translation = Translation3::from(self.vector()?);
        let [i, j, k, w] = [self.number()?, self.number()?, self.number()?, self.number()?];
        let quaternion = Quaternion::new(w, i, j, k);
        if (quaternion.norm() - 1.0).abs() > 1e-6 {
            return Err(EngineError::Snapshot { reason: "the attitude is no rotation" });
        }
        // Not normalised: the bits are the state.
        let pose = Isometry3::from_parts(translation, UnitQuaternion::new_unchecked(quaternion));
        let twist = Twist { linear: self.vector()?, angular: self.vector()? };
        let (arc_length_m, offset_m) = (self.number()?, self.number()?);
        let mut feet_m = [0.0; RINGS];
        for foot_m in &mut feet_m {
            *foot_m = self.number()?;
        }
        let segment_index = self.whole()? as usize;
        let (passed, left) = (self.flag()?, self.flag()?);
        Ok(Moved { pose, twist, arc_length_m, offset_m, feet_m, segment_index, passed, left })
    }
}

impl Engine {
    /// The exact state as bytes.
    pub fn snapshot(&self) -> Vec<u8> {
        let mut out = Writer(Vec::with_capacity(512));
        out.0.extend_from_slice(MAGIC);
        out.0.extend_from_slice(&VERSION.to_le_bytes());
        out.whole(self.fingerprint());
        out.whole(self.step_index);
        out.vector(&self.gravity_world_m_s2);
        for w in &self.wrench_world {
            out.vector(w);
        }
        out.vector(&self.specific_force_capsule_m_s2);
        out.number(self.wall_force_n);
        out.whole(self.touching as u64);
        let watch = &self.watch;
        out.whole(watch.segment_index as u64);
        out.whole(watch.last_touch.0 as u64);
        out.whole(u64::from(watch.lost));
        out.number(watch.anchor_m);
        out.whole(watch.anchored.0 as u64);
        out.whole(u64::from(watch.stalled));
        out.whole(u64::from(watch.retained));
        out.number(watch.crossed_m.unwrap_or(NOWHERE_M));
        out.whole(self.sleep.rested_steps);
        // Awake: a time that nothing can have.
        out.number(self.sleep.until_s.map_or(AWAKE_S, |until_s| until_s.min(f64::MAX)));
        for (index, mover) in self.movers.iter().enumerate() {
            out.mover(mover, &self.bodies.pose(index), &self.bodies.twist(index));
        }
        out.0
    }

    /// Takes on the state of a snapshot of an engine built alike.
    ///
    /// # Errors
    /// [`EngineError::Snapshot`]: other bytes, another version, another scenario. The engine is then as it was.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), EngineError> {
        let mut from = Reader(bytes);
        if &from.bytes::<4>()? != MAGIC {
            return Err(EngineError::Snapshot { reason: "wrong magic" });
        }
        if u32::from_le_bytes(from.bytes()?) != VERSION {
            return Err(EngineError::Snapshot { reason: "another version" });
        }
        if from.whole()? != self.fingerprint() {
            return Err(EngineError::Snapshot {
                reason: "another configuration, capsule, tract, or other things in it",
            });
        }
        let step_index = from.whole()?;
        let gravity_world_m_s2 = from.vector()?;
        let wrench_world = [from.vector()?, from.vector()?];
        let specific_force_capsule_m_s2 = from.vector()?;
        let wall_force_n = from.number()?;
        let touching = from.whole()? as usize;
        let mut watch = self.watch;
        watch.segment_index = from.whole()? as usize;
        watch.last_touch = SimTime(from.whole()? as i64);
        watch.lost = from.flag()?;
        watch.anchor_m = from.number()?;
        watch.anchored = SimTime(from.whole()? as i64);
        watch.stalled = from.flag()?;
        watch.retained = from.flag()?;
        let crossed_m = from.number()?;
        watch.crossed_m = (crossed_m > NOWHERE_M).then_some(crossed_m);
        let (rested_steps, until_s) = (from.whole()?, from.number()?);
        let sleep = Sleep { rested_steps, until_s: (until_s > AWAKE_S).then_some(until_s) };
        let mut all = Vec::with_capacity(self.movers.len());
        for _ in &self.movers {
            all.push(from.mover()?);
        }
        if !from.0.is_empty() {
            return Err(EngineError::Snapshot { reason: "too long" });
        }
        let segments = all.iter().map(|moved| moved.segment_index);
        if segments.chain([watch.segment_index]).any(|index| index >= self.tract.segments.len()) {
            return Err(EngineError::Snapshot { reason: "a segment that the tract lacks" });
        }
        self.step_index = step_index;
        for (index, moved) in all.iter().enumerate() {
            self.put(index, moved);
        }
        self.gravity_world_m_s2 = gravity_world_m_s2;
        self.wrench_world = wrench_world;
        self.specific_force_capsule_m_s2 = specific_force_capsule_m_s2;
        (self.wall_force_n, self.touching) = (wall_force_n, touching);
        self.watch = watch;
        self.sleep = sleep;
        self.events.clear();
        self.lumen.advance_to(step_index as f64 * self.step_s);
        Ok(())
    }

    fn put(&mut self, index: usize, moved: &Moved) {
        self.bodies.set_pose(index, &moved.pose);
        self.bodies.set_twist(index, &moved.twist);
        let mover = &mut self.movers[index];
        mover.station = self.tract.centre_line.station(moved.arc_length_m);
        mover.offset_m = moved.offset_m;
        mover.contacts.set_feet_m(moved.feet_m);
        mover.segment_index = moved.segment_index;
        if let Some(valve) = &mut mover.valve {
            valve.passed = moved.passed;
        }
        mover.left = moved.left;
        self.bodies.set_present(index, index == CAPSULE || !moved.left);
    }

    /// FNV-1a over what the engine was built from: configuration, capsule, tract, motility, patient, obstacles and diverticula, each in full.
    pub(crate) fn fingerprint(&self) -> u64 {
        let constant = self.fingerprint.get_or_init(|| {
            let mut hash = Fnv::default();
            hash.add(&format_args!("{:?}{:?}", self.config, self.capsule().shape));
            hash.add(&format_args!("{:?}", self.tract));
            hash.add(&format_args!("{}", self.lumen.motility().fingerprint_text()));
            if let Some(patient) = &self.patient {
                hash.add(&format_args!("{}", patient.fingerprint_text()));
            }
            hash.0
        });
        let mut hash = Fnv(*constant);
        hash.add(&format_args!("{:?}", self.lumen.diverticula()));
        hash.add(&format_args!("{}{:?}", self.inserted, self.together.joints()));
        hash.0
    }
}

/// FNV-1a of text, as it is written.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn add(&mut self, text: &fmt::Arguments<'_>) {
        // Writing to this never fails, and neither do the derived formatters of numbers and structs.
        let _ = self.write_fmt(*text);
    }
}

impl fmt::Write for Fnv {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        Ok(())
    }
}
