//! How a capsule passes the gut, against published transit times, speeds, forces and gastric motion.
//!
//! One cohort for all of it ([`person`]): persons of three sizes in turn, each with motility of its own, in the whole tract; a passage starts at the
//! entrance of its segment. What was tuned to which number stands among the settings of each table, with the persons it was tuned on.

mod gastric;
mod person;
mod speeds;
mod stalls;
mod traction;
mod transit;

use crate::registry::Reproduction;

/// The reproductions of this subject.
pub(crate) const ALL: &[Reproduction] = &[
    Reproduction {
        id: "gut/transit",
        source: "transit times of capsules and magnetic pills: World J Gastroenterol 14:5707 (oesophagus), O'Grady et al. (small bowel), surveys of capsule endoscopy (stomach)",
        about: "transit time of oesophagus, stomach and small bowel from their entrance against published means and quartiles",
        default_seeds: &[1],
        run: transit::run,
    },
    Reproduction {
        id: "gut/colon",
        source: "surveys of colonic transit by capsules and motility pills, medians of 15.9 to 28.9 h",
        about: "transit time of the colon against published medians",
        default_seeds: &[1],
        run: transit::run_colon,
    },
    Reproduction {
        id: "gut/exam",
        source: "no source tells the sum of the segments",
        about: "whole exams from the swallow to the way out",
        default_seeds: &[1],
        run: transit::run_exam,
    },
    Reproduction {
        id: "gut/speeds",
        source: "small-bowel speeds derived from O'Grady et al. (198 min) and magnet tracking",
        about: "distribution of a capsule's speed in the small bowel: little of the time makes most of the way",
        default_seeds: &[1],
        run: speeds::run,
    },
    Reproduction {
        id: "gut/traction",
        source: "Ahluwalia et al., Gut 1994",
        about: "aboral force on a body held in the jejunum, per contraction, in phases II and III",
        default_seeds: &[1],
        run: traction::run,
    },
    Reproduction {
        id: "gut/gastric",
        source: "3D-Transit, 125 people; contraction rate and motion per contraction",
        about: "contractions of the stomach, and how far and by how much each moves and turns a capsule",
        default_seeds: &[1],
        run: gastric::run,
    },
];

/// What of the motility was tuned, to what, on whom: persons that are in no table.
const TUNED: &str = "on seeds 1000 and up (none of them here): grip 0.04 of the oesophagus to 5.2 s upright; rate, growth, amplitude and spread of its \
waves to 23.6 s supine; amplitude of antral waves and share that opens the pylorus to a gastric median of 22 min; speeds, amplitudes, runs, direction and spread of contractions and grip of \
the small bowel to quartiles of 157, 198 and 240 min upright, with a look at the traction of phases II and III, which also told that contractions have to keep clear of each other; amplitude of the fed \
small bowel to 58 mN; rate (24 a day, where those of high amplitude are 6.9 to 10) and origins of the colon's mass movements to a median of 16 to 29 h; \
nothing to speeds or gastric motion. \
The three shipped guts are those of the tuning; what a seed draws is new, and upright the oesophagus draws nothing that matters: its persons are three lengths";
