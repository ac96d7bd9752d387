//! The bed under a patient in a scanner (than2015, section 4.5): the capsule is kept near the middle of the field of view.
//!
//! The world is the patient's, so it is the scanner that moves in it. With z the place along the scanner's axis:
//!
//! ```text
//! e = z_capsule - z_scanner          last published estimate less encoder
//! v = sign(e) min(k (|e| - b), v_max)  for |e| > b, else 0
//! ```
//!
//! Within the dead band b nothing moves. The bed stands still as well where no estimate was ever published, where the last one is
//! older than the patience, or where it is less certain than the dead band is wide. It never leaves its travel: a decision holds until the
//! next, so its speed is cut to what reaches the end by then.

use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{Command, ConfigError, Controller, Name, Node, PublishedEstimate, SimTime};
use nalgebra::{Isometry3, Vector6};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `[controller.law]` of kind `bed`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BedTable {
    /// Half the width of the stretch in which nothing moves, mm. Default 10.
    #[serde(default = "dead_band")]
    pub dead_band_mm: NonNegative,
    /// Speed per distance beyond the dead band, 1/s. Default 1.
    #[serde(default = "one")]
    pub gain_per_s: Positive,
    /// Largest speed, mm/s. Default 25.
    #[serde(default = "max_speed")]
    pub max_speed_mm_s: Positive,
    /// Places of the scanner between which the bed can move, in the patient's frame, mm. Default -500 to 500.
    #[serde(default = "travel")]
    pub travel_mm: [Finite; 2],
    /// Estimates that are older than this are not followed, s. Default 2.
    #[serde(default = "patience")]
    pub patience_s: Positive,
}

fn dead_band() -> NonNegative {
    NonNegative(10.0)
}
fn one() -> Positive {
    Positive(1.0)
}
fn max_speed() -> Positive {
    Positive(25.0)
}
fn travel() -> [Finite; 2] {
    [Finite(-500.0), Finite(500.0)]
}
fn patience() -> Positive {
    Positive(2.0)
}

const SOURCES: [(&str, &str); 5] = [
    ("dead_band_mm", "chosen: a tenth of the axial field of view of 18 cm, so that rest is rest"),
    ("gain_per_s", "chosen: ten times slower than the estimates that it follows"),
    ("max_speed_mm_s", "chosen: a little above a mass movement in the colon (22 mm/s)"),
    ("travel_mm", "chosen: a trunk's length"),
    ("patience_s", "chosen: 50 mm at the largest speed, half of the axial field of view"),
];

/// The controller.
#[derive(Clone, Debug)]
pub struct Bed {
    scanner: Name,
    law: BedTable,
    rate_hz: f64,
}

impl Bed {
    /// Reads `[controller.law]`; `scanner` is the sensor that is moved.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key and what is allowed.
    pub fn from_node(node: &Node, scanner: Name, rate_hz: f64) -> Result<Self, ConfigError> {
        let law: BedTable = node.parse_sourced(&SOURCES)?;
        if law.travel_mm[0].0 >= law.travel_mm[1].0 {
            return Err(node.error_at("travel_mm", "give the lower end first: [lower, upper] in mm"));
        }
        if law.gain_per_s.0 > rate_hz {
            let message = format!(
                "{} /s overshoots at {rate_hz} decisions a second; give at most that",
                law.gain_per_s.0
            );
            return Err(node.error_at("gain_per_s", &message));
        }
        Ok(Self { scanner, law, rate_hz })
    }

    /// Speed along z, m/s.
    fn speed_m_s(&self, now: SimTime, last: Option<&PublishedEstimate>, scanner_z_m: f64) -> f64 {
        let Some(last) = last else { return 0.0 };
        let age_s = now.seconds() - last.at.seconds();
        let band_m = 1e-3 * self.law.dead_band_mm.0;
        let sigma_m = last.pose.covariance[(2, 2)].max(0.0).sqrt();
        let offset_m = last.pose.world_from_capsule.translation.z - scanner_z_m;
        let beyond_m = offset_m.abs() - band_m;
        // Negated, so that what is not a number stands still.
        if !(age_s <= self.law.patience_s.0 && sigma_m <= band_m.max(SUREST_M) && beyond_m > 0.0) {
            return 0.0;
        }
        let speed = (self.law.gain_per_s.0 * beyond_m).min(1e-3 * self.law.max_speed_mm_s.0);
        let [low_m, high_m] = self.law.travel_mm.map(|end| 1e-3 * end.0);
        let to_end_m = if offset_m > 0.0 { high_m - scanner_z_m } else { scanner_z_m - low_m };
        speed.min(to_end_m.max(0.0) * self.rate_hz) * offset_m.signum()
    }
}

/// Without a dead band, estimates of this standard deviation are followed, m.
const SUREST_M: f64 = 5e-3;

impl Controller for Bed {
    fn step(
        &mut self,
        now: SimTime,
        last: Option<&PublishedEstimate>,
        known_poses: &BTreeMap<String, Isometry3<f64>>,
    ) -> Vec<Command> {
        let Some(scanner) = known_poses.get(&*self.scanner) else { return Vec::new() };
        let speed_m_s = self.speed_m_s(now, last, scanner.translation.z);
        let twist_world = Vector6::new(0.0, 0.0, speed_m_s, 0.0, 0.0, 0.0);
        vec![Command { actuator: self.scanner.clone(), twist_world }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::{FixKind, PoseEstimate};
    use nalgebra::Matrix6;
    use std::path::Path;

    fn bed(text: &str) -> Result<Bed, ConfigError> {
        let node = Node::parse_text(text, "bed.toml", Path::new("."), &[])?;
        Bed::from_node(&node, "scanner".into(), 1.0)
    }

    fn estimate(at_s: f64, z_m: f64, sigma_m: f64) -> PublishedEstimate {
        let at = SimTime::from_seconds(at_s);
        PublishedEstimate {
            at,
            available: at,
            pose: PoseEstimate {
                world_from_capsule: Isometry3::translation(0.01, 0.02, z_m),
                covariance: Matrix6::identity() * sigma_m * sigma_m,
                kind: FixKind::Full,
            },
            velocity_world_m_s: None,
        }
    }

    fn speed_mm_s(bed: &mut Bed, now_s: f64, last: Option<&PublishedEstimate>, scanner_z_m: f64) -> f64 {
        let known = BTreeMap::from([("scanner".to_owned(), Isometry3::translation(0.0, 0.0, scanner_z_m))]);
        let commands = bed.step(SimTime::from_seconds(now_s), last, &known);
        assert_eq!((commands.len(), &*commands[0].actuator), (1, "scanner"));
        1e3 * commands[0].twist_world[2]
    }

    #[test]
    fn closed_form_speed_by_distance() {
        let mut bed = bed("gain_per_s = 0.5\nmax_speed_mm_s = 20\n").unwrap();
        for (z_mm, expected) in
            [(9.0, 0.0), (-10.0, 0.0), (30.0, 10.0), (-30.0, -10.0), (90.0, 20.0), (-900.0, -20.0)]
        {
            let here = speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, 0.1 + 1e-3 * z_mm, 1e-3)), 0.1);
            assert!((here - expected).abs() < 1e-9, "{z_mm} mm: {here}");
        }
    }

    #[test]
    fn law_the_bed_stands_where_nothing_certain_and_new_is_known() {
        let mut bed = bed("travel_mm = [-100, 100]\n").unwrap();
        assert_eq!(speed_mm_s(&mut bed, 1.0, None, 0.0), 0.0);
        assert_eq!(speed_mm_s(&mut bed, 4.0, Some(&estimate(1.0, 0.05, 1e-3)), 0.0), 0.0);
        assert_eq!(speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, 0.05, 0.02)), 0.0), 0.0);
        assert_eq!(speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, f64::NAN, 1e-3)), 0.0), 0.0);
        // Of 30 mm that are left it goes 30 in the second until the next decision; at the end of its travel it goes back alone.
        bed.law.max_speed_mm_s = Positive(1e3);
        assert!((speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, 0.5, 1e-3)), 0.07) - 30.0).abs() < 1e-9);
        assert_eq!(speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, 0.3, 1e-3)), 0.1), 0.0);
        assert!(speed_mm_s(&mut bed, 1.0, Some(&estimate(1.0, -0.3, 1e-3)), 0.1) < 0.0);
        // A sensor that tells no place is not moved.
        assert!(bed.step(SimTime::ZERO, None, &BTreeMap::new()).is_empty());
    }

    #[test]
    fn law_bad_tables_are_refused_with_their_key() {
        for (text, key) in [
            ("travel_mm = [10, -10]", "travel_mm"),
            ("max_speed_mm_s = 0", "max_speed_mm_s"),
            ("gain_per_s = 3", "gain_per_s"),
            ("speed = 1", "speed"),
        ] {
            let error = bed(text).unwrap_err().to_string();
            assert!(error.contains(key) && error.contains("bed.toml"), "{error}");
        }
    }
}
