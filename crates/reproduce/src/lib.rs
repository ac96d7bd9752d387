//! Published tables and figures, re-run: what was published, what comes out here, and a verdict per row.
//!
//! A [`Reproduction`] is known by its id, `<publication>/<table>`; [`all`] lists those there are, [`find`] looks one up. Running one
//! gives a [`Table`]: rows with the published value, ours per estimator, a tolerance and a [`Verdict`], the settings with which it
//! was made, the seeds, and figures as SVG.
//!
//! ```no_run
//! use lumenav_core::ModelFolder;
//! use lumenav_reproduce::{Context, OneAfterAnother, Size, find};
//! let models = ModelFolder::new("models");
//! let reproduction = find("than2015/rates").ok_or("not known")?;
//! let context = Context::new(&models, reproduction.seeds(None, Size::Full), Size::Full, &OneAfterAnother);
//! for row in reproduction.run(&context)?.rows {
//!     println!("{}: published {:?}, ours {:?}: {}", row.quantity, row.published, row.ours, row.verdict);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Same seeds and size, same bytes, whatever the [`Executor`] does with the jobs. What a source does not state is not guessed: the
//! choice made here stands among the settings. A row is never left out because it came out badly.

mod context;
mod error;
mod files;
mod gut;
mod moussakhani2012;
mod registry;
mod table;
pub mod than2015;
mod verdict;

pub use context::{Context, Executor, OneAfterAnother, Progress, Size};
pub use error::ReproduceError;
pub use files::{FilesError, check_free, table_path};
pub use registry::{Reproduction, all, find};
pub use table::{NamedFigure, Row, SCHEMA, Table};
pub use verdict::{Goal, Sense, Tolerance, Verdict};
