//! Tracts that several tests of this crate share.

use crate::segment::SegmentKey;
use crate::tract::{End, SegmentPoints, Tract, TractDraft};
use nalgebra::Point3;

/// A straight stomach and a straight duodenum of 0.2 m each along z, of one radius; the pylorus is at 0.2 m.
pub(crate) fn stomach_and_duodenum(radius_m: f64) -> Tract {
    let piece = |key: SegmentKey, from_m: f64| SegmentPoints {
        key,
        points_m: (0..=4).map(|i| Point3::new(0.0, 0.0, from_m + 0.05 * f64::from(i))).collect(),
        radii_m: vec![radius_m; 5],
        wall: key.default_wall(),
        source: String::new(),
    };
    let draft = TractDraft {
        name: "t".into(),
        segments: vec![piece(SegmentKey::Stomach, 0.0), piece(SegmentKey::Duodenum, 0.2)],
        ends: (End::Closed, End::Exit),
        torso_half_extents_m: None,
        source: String::new(),
    };
    draft.build().unwrap().0
}
