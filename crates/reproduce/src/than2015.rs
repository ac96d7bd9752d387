//! T. D. Than, *Localization and tracking of robotic endoscopic capsules using multiple positron emission markers*, PhD thesis,
//! University of Wollongong, 2015: its tables and figures of chapters 3 to 6.
//!
//! [`published`] holds the numbers, [`motion`] the paths, [`set_up`] scanners, phantoms and markers, [`scoring`] what counts as an
//! error and as a failure. Numbers that this project has no record of are not invented: such a row says *not available*.

mod dose;
pub mod estimators;
mod few_lines;
pub mod follow;
pub mod motion;
pub mod published;
mod rates;
pub mod scoring;
pub mod set_up;
pub mod source;

use crate::registry::Reproduction;

/// The reproductions of this publication.
pub(crate) const ALL: &[Reproduction] = &[
    Reproduction {
        id: "than2015/rates",
        source: "than2015, table 4.2",
        about: "lines per window and their true share: five water cylinders, full ring and reduced scanner",
        default_seeds: &[1],
        run: rates::run,
    },
    Reproduction {
        id: "than2015/few-lines",
        source: "than2015, table 4.3",
        about: "marker error and failures with 284 to 54 lines per window, reduced scanner; fast motion",
        default_seeds: &[1, 2, 3],
        run: few_lines::run,
    },
    Reproduction {
        id: "than2015/dose",
        source: "than2015, section 3.6 and figure 3.10",
        about: "dose of a resting capsule, and the smallest activity for a rate of poses",
        default_seeds: &[],
        run: dose::run,
    },
];
