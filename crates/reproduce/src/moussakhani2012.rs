//! B. Moussakhani, T. Ramstad, J. T. Flåm, I. Balasingham, *On localizing a capsule endoscope using magnetic sensors*, 2012: its figures
//! 2 to 5 with equations 6 and 10 to 14 corrected, and the comparison with radio of its section 4.
//!
//! The paper shows curves and says in words what they show; a row is such a claim, put as a number, with what its own model gives.
//! Position (a, b, c), axis h; bounds are square roots of the Cramér-Rao bound of one reading. The claims are judged for
//! the model as it is stated: three-axis sensors, grids that include their edge.

mod distance;
mod network;
mod planes;
mod rotation;
mod sensors;
mod trials;
mod versus_rss;

use crate::registry::Reproduction;

/// The reproductions of this publication.
pub(crate) const ALL: &[Reproduction] = &[
    Reproduction {
        id: "moussakhani2012/sensors",
        source: "moussakhani2012, figure 2",
        about: "bound against the number of sensors on a grid and on a line; maximum likelihood beside it",
        default_seeds: &[1],
        run: sensors::run,
    },
    Reproduction {
        id: "moussakhani2012/distance",
        source: "moussakhani2012, figure 3",
        about: "bound against the magnet's distance from the grid",
        default_seeds: &[],
        run: distance::run,
    },
    Reproduction {
        id: "moussakhani2012/rotation",
        source: "moussakhani2012, figure 4",
        about: "bound against the magnet's turn from the normal into the plane",
        default_seeds: &[],
        run: rotation::run,
    },
    Reproduction {
        id: "moussakhani2012/planes",
        source: "moussakhani2012, figure 5",
        about: "bound between two facing planes, above two coincident ones, and above one",
        default_seeds: &[],
        run: planes::run,
    },
    Reproduction {
        id: "moussakhani2012/versus-rss",
        source: "moussakhani2012, section 4",
        about: "bound of a magnet against that of received radio strength, at equal number and distance",
        default_seeds: &[],
        run: versus_rss::run,
    },
];
