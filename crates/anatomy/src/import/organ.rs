//! Which segments a line has, and where each begins.
//!
//! A surface does not tell. Either the user names the places where segments begin ([`SegmentStart`]), each moved to the nearest
//! station; or an organ is divided by proportions measured in two people (Edin 00090 and Visible Human male, centre lines
//! of the GCA-Models, CC BY 4.0), which is said in a warning. The mean of their fractions of the whole:
//!
//! | small bowel | Edin, m | VHM, m | fraction | | colon | Edin, m | VHM, m | fraction |
//! |---|---|---|---|---|---|---|---|---|
//! | duodenum | 0.142 | 0.241 | 0.077 | | caecum | 0.063 | 0.049 | 0.045 |
//! | jejunum | 0.973 | 1.219 | 0.446 | | ascending | 0.117 | 0.199 | 0.121 |
//! | ileum | 1.169 | 1.152 | 0.477 | | transverse | 0.339 | 0.380 | 0.283 |
//! | | | | | | descending | 0.395 | 0.322 | 0.288 |
//! | | | | | | sigmoid and rectum | 0.270 | 0.428 | 0.263 |

use super::error::ImportError;
use super::middle::ImportStation;
use crate::segment::SegmentKey;
use nalgebra::Point3;

/// What a surface shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Organ {
    /// From the pylorus to the ileocaecal valve.
    SmallBowel,
    /// From the caecum to the anus.
    Colon,
}

/// Length over median radius below which a gut is taken for a colon. Small bowels measure about 330 (2.5 m, 7.5 mm), colons about 80
/// (1.2 m, 15 mm); the geometric mean is 163.
const SLENDER: f64 = 163.0;

/// Where a segment begins, in order from mouth to anus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentStart {
    /// Which.
    pub key: SegmentKey,
    /// A place at its beginning, surface frame, m.
    pub at_m: Point3<f64>,
}

impl Organ {
    /// The organ of a tube so long and wide.
    pub(super) fn of(length_m: f64, radius_m: f64) -> Self {
        if length_m > SLENDER * radius_m { Self::SmallBowel } else { Self::Colon }
    }

    /// Its name in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::SmallBowel => "small bowel",
            Self::Colon => "colon",
        }
    }

    /// Its segments with the fraction of the length at which each begins.
    fn proportions(self) -> &'static [(SegmentKey, f64)] {
        match self {
            Self::SmallBowel => {
                &[(SegmentKey::Duodenum, 0.0), (SegmentKey::Jejunum, 0.077), (SegmentKey::Ileum, 0.523)]
            }
            // The rectum was measured in one of the two: 0.075 of 1.184 m.
            Self::Colon => &[
                (SegmentKey::Caecum, 0.0),
                (SegmentKey::Ascending, 0.045),
                (SegmentKey::Transverse, 0.166),
                (SegmentKey::Descending, 0.449),
                (SegmentKey::Sigmoid, 0.737),
                (SegmentKey::Rectum, 0.937),
            ],
        }
    }

    /// First station of each segment by proportion. Stations are evenly spaced.
    pub(super) fn divided(self, stations: usize) -> Vec<(SegmentKey, usize)> {
        let last = stations.saturating_sub(1) as f64;
        self.proportions().iter().map(|(key, part)| (*key, (part * last).round() as usize)).collect()
    }
}

/// A place further than this from the line is no place of its segment, m: twice the radius of the widest colon.
const FURTHEST_START_M: f64 = 0.05;

/// First station of each segment that the user names; the first begins the line.
pub(super) fn named(
    starts: &[SegmentStart],
    stations: &[ImportStation],
    file: &str,
) -> Result<Vec<(SegmentKey, usize)>, ImportError> {
    let mut result: Vec<(SegmentKey, usize)> = Vec::new();
    for (number, start) in starts.iter().enumerate() {
        let apart = |i: &usize| (stations[*i].point_m - start.at_m).norm();
        let nearest = (0..stations.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0);
        let away_m = stations.get(nearest).map_or(0.0, |_| apart(&nearest));
        if away_m > FURTHEST_START_M {
            return Err(ImportError::StartAway {
                file: file.to_owned(),
                segment: start.key,
                away_mm: 1e3 * away_m,
                most_mm: 1e3 * FURTHEST_START_M,
            });
        }
        let station = if number == 0 { 0 } else { nearest };
        if let Some((before, at)) =
            result.last().filter(|(before, at)| *before >= start.key || at + 1 >= station)
        {
            let along = |i: usize| {
                1e3 * super::middle::chords_m(&stations[..=i].iter().map(|s| s.point_m).collect::<Vec<_>>())
            };
            return Err(ImportError::SegmentOrder {
                file: file.to_owned(),
                before: *before,
                before_mm: along(*at),
                after: start.key,
                at_mm: along(station),
            });
        }
        result.push((start.key, station));
    }
    Ok(result)
}
