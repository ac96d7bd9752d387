//! How many lines of a window are looked at (than2015, section 5.5).

use serde::{Deserialize, Serialize};

/// How many lines of a window are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Budget {
    /// All.
    All,
    /// At most so many, evenly over the window.
    AtMost(usize),
    /// All in the first window, then as many as give about so many true lines per marker, with the share of true lines that
    /// the last window had: the one at the last axial position.
    TruePerMarker(usize),
}

/// than2015, section 5.5: about 100 true lines per marker.
pub const TRUE_LINES_PER_MARKER: usize = 100;

impl Budget {
    /// Lines to take; `None`: all. `background_share` of the last window, `None` before the first.
    pub fn lines(self, markers: usize, background_share: Option<f64>) -> Option<usize> {
        match (self, background_share) {
            (Self::All, _) | (Self::TruePerMarker(_), None) => None,
            (Self::AtMost(lines), _) => Some(lines),
            (Self::TruePerMarker(each), Some(background)) => {
                // A window that is nearly all background tells no share: at most ten times the true lines are looked at.
                Some(((each * markers) as f64 / (1.0 - background).clamp(0.1, 1.0)).ceil() as usize)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_lines_for_a_hundred_true_ones_per_marker() {
        let budget = Budget::TruePerMarker(TRUE_LINES_PER_MARKER);
        assert_eq!(budget.lines(3, None), None);
        assert_eq!(budget.lines(3, Some(0.25)), Some(400));
        assert_eq!(budget.lines(4, Some(0.999)), Some(4000));
        assert_eq!(Budget::AtMost(210).lines(3, Some(0.5)), Some(210));
        assert_eq!(Budget::All.lines(3, Some(0.5)), None);
    }
}
