//! Places along a tract as scenarios name them.

use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::config::quantity::NonNegative;
use lumenav_core::{ConfigError, Node};

/// Arc length of `at_mm` behind the oral end of `segment` (of the tract where it is not given), m. `node` is the table with these keys.
///
/// # Errors
/// [`ConfigError`] with file, line and key: the tract has no such segment, or the place is beyond its end.
pub(crate) fn arc_length_m(
    segment: Option<SegmentKey>,
    at_mm: NonNegative,
    tract: &Tract,
    node: &Node,
) -> Result<f64, ConfigError> {
    let (origin_m, end_m, whose) = match segment {
        None => (0.0, tract.length_m(), "tract"),
        Some(key) => {
            let segment = tract.segment(key).ok_or_else(|| {
                let there = tract.segments.iter().map(|s| s.key.as_str()).collect::<Vec<_>>().join(", ");
                node.error_at("segment", &format!("the tract has no {key}; allowed: {there}"))
            })?;
            (segment.start_m, segment.end_m, key.as_str())
        }
    };
    let s_m = origin_m + 1e-3 * at_mm.0;
    if s_m > end_m {
        let most_mm = 1e3 * (end_m - origin_m);
        let message = format!("is beyond the end of the {whose}; allowed: 0 to {most_mm:.0}");
        return Err(node.error_at("at_mm", &message));
    }
    Ok(s_m)
}
