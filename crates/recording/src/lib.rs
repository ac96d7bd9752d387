//! Recordings for the Rerun viewer: an observer of a run that streams what happens into an `.rrd` file or a viewer.
//!
//! # Entities
//!
//! | path | content |
//! |---|---|
//! | `/world/<path>` | what the world draws: `tract/lumen`, `tract/centre_line`, `body` |
//! | `/world/capsule/truth` | true pose with the capsule's solid and axes |
//! | `/world/capsule/path` | true path, in pieces |
//! | `/world/sensors/<sensor>/<path>` | what a sensor draws of itself |
//! | `/world/tracks/<track>/<sensor>/<path>` | what the track's front end makes of the sensor's readings |
//! | `/world/tracks/<track>/pose` | estimated pose with the capsule's outline |
//! | `/world/tracks/<track>/path` | estimated path, in pieces |
//! | `/world/tracks/<track>/covariance` | ellipsoid: 95 % region of the position |
//! | `/camera/<sensor>/<path>` | images, JPEG |
//! | `/plots/error/<track>` | position error, mm |
//! | `/plots/nees/<track>` | squared error over covariance; `/plots/nees/band_<n>_dof` its 95 % band |
//! | `/plots/along_tract/{truth,<track>}` | arc length from the tract's start, m |
//! | `/segment` | the segment the capsule is in, where it changes (`StateChange`) |
//! | `/plots/moved/<controller>` | where the sensor that it moves stands along z, mm |
//! | `/events/{notes,refusals,missing}` | text log; bursts condensed to their first and a closing line |
//!
//! Timelines: `sim_time` (duration) on everything, `update` (count of the track's updates) on tracks and their plots.
//! Positions are world metres in `f32` (half a micrometre at 4 m). How much is kept: see the rule in `pacing`; the numbers
//! of record are those in Parquet and JSON, not these.
//!
//! [`Still`] is a scene without a course in time: `/world/<path>` and `/about`, a text beside it.
//!
//! Two equal runs give recordings with equal bytes: the recorder names rows and chunks by counting, never by the clock.

mod blueprint;
mod bursts;
mod drawn;
mod error;
mod geometry;
mod inspect;
mod output;
mod pacing;
mod palette;
mod primitives;
mod recorder;
mod still;
mod store;
mod trail;

pub use error::RecordingError;
pub use inspect::{RrdSummary, inspect, read_scalars};
pub use recorder::{RecorderOptions, RrdRecorder};
pub use still::Still;
pub use store::{SIM_TIME, UPDATE};
