//! T. D. Than, *Localization and tracking of robotic endoscopic capsules using multiple positron emission markers*, PhD thesis,
//! University of Wollongong, 2015: its tables and figures of chapters 3 to 6.
//!
//! [`published`] holds the numbers, [`motion`] the paths, [`set_up`] scanners, phantoms and markers, [`scoring`] what counts as an
//! error and as a failure. Numbers that this project has no record of are not invented: such a row says *not available*.

mod case;
mod dose;
pub mod estimators;
mod experiment;
mod few_lines;
pub mod follow;
mod jump;
pub mod motion;
mod point_registration;
pub mod published;
mod rates;
pub mod scoring;
pub mod set_up;
pub mod source;
mod speed_and_size;
mod static_cylinder;
mod torso;
mod window_and_activity;

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
        id: "than2015/jump",
        source: "than2015, figure 4.11",
        about: "the capsule jumps by 50 mm: lost without failure prediction, found with it",
        default_seeds: &[1, 2, 3],
        run: jump::run,
    },
    Reproduction {
        id: "than2015/static-cylinder",
        source: "than2015, section 4.3.2 and table 4.1",
        about: "marker error with 210 of 2,410 lines per window, full ring, cylinder of 20 cm",
        default_seeds: &[1],
        run: static_cylinder::run,
    },
    Reproduction {
        id: "than2015/dose",
        source: "than2015, section 3.6 and figure 3.10",
        about: "dose of a resting capsule, and the smallest activity for a rate of poses",
        default_seeds: &[],
        run: dose::run,
    },
    Reproduction {
        id: "than2015/speed-and-size",
        source: "than2015, figure 4.12",
        about: "marker error at 5 to 40 mm/s in cylinders of 20, 30 and 40 cm, full ring",
        default_seeds: &[1],
        run: speed_and_size::run,
    },
    Reproduction {
        id: "than2015/window-and-activity",
        source: "than2015, section 4.5",
        about: "marker error against length of the window and activity of the markers, full ring",
        default_seeds: &[1],
        run: window_and_activity::run,
    },
    Reproduction {
        id: "than2015/torso",
        source: "than2015, section 4.4",
        about: "a colon in a voxel torso at 1 mm/s: lines, true share, marker error",
        default_seeds: &[1],
        run: torso::run,
    },
    Reproduction {
        id: "than2015/experiment-tf64",
        source: "than2015, tables 5.2 and 6.1",
        about: "the experiment with the TF64 scanner, simulated: three half circles, 480 s",
        default_seeds: &[1],
        run: experiment::tf64,
    },
    Reproduction {
        id: "than2015/experiment-allegro",
        source: "than2015, tables 5.3 and 6.2",
        about: "the experiment with the Allegro scanner, simulated: three half circles, 480 s",
        default_seeds: &[1],
        run: experiment::allegro,
    },
    Reproduction {
        id: "than2015/point-registration",
        source: "than2015, section 6.5",
        about: "a rigid fit to the free markers of fcm against the pose from the lines",
        default_seeds: &[1],
        run: point_registration::run,
    },
];
