//! Layout design: which sensors should one build, and where do they go?
//!
//! Everything rests on the Fisher information of one reading ([`lumenav_core::LayoutModel`]), which every modality that can be laid out
//! gives; nothing here knows a magnet from a scanner. The rooms:
//!
//! | room | what |
//! |---|---|
//! | [`workspace`] | the poses at which a layout is judged |
//! | [`information`] | from an information to the bound of position and angle |
//! | [`mod@evaluate`] | the map over the workspace, criteria, what is left when sensors die |
//! | [`criterion`] | what an optimal layout is optimal in, with derivatives |
//! | [`mod@posterior`] | what a filter can reach along a path |
//! | [`optimize`] | choosing from candidates, moving freely, and how far from optimal one is at most |
//! | [`study`] | the `[layout]` tables of a scenario |
//!
//! The bound is local and holds for unbiased estimators: it knows nothing of flips, wrong starts or models that do not fit.

pub mod criterion;
pub mod evaluate;
pub mod information;
pub mod optimize;
pub mod posterior;
pub mod study;
pub mod workspace;

pub use criterion::Criterion;
pub use evaluate::{Evaluation, Summary, evaluate};
pub use information::{Inverse, PoseBound};
pub use posterior::{Posterior, posterior};
pub use study::Study;
pub use workspace::{Workspace, WorkspaceTable};

/// Why a layout could not be judged or found.
#[derive(Debug, thiserror::Error)]
pub enum LayoutError {
    /// A file of the user's says something that is not allowed.
    #[error(transparent)]
    Config(#[from] Box<lumenav_core::ConfigError>),
    /// The plugin's.
    #[error(transparent)]
    Modality(#[from] lumenav_core::ModalityError),
    /// Elements that work only together cannot be chosen one by one.
    #[error(
        "the elements of this sensor work only together (coincidences of two); they cannot be chosen or moved one by one; give them as [[layout.alternative]] and use `lumenav layout compare`"
    )]
    Dependent,
    /// No layout of so many elements is possible.
    #[error("{0}")]
    Impossible(String),
    /// Stopped, and what was found so far has been kept.
    #[error("stopped; the best layout so far is kept")]
    Interrupted,
    /// Stopped before anything was found.
    #[error("stopped before a first layout was found")]
    Stopped,
}

impl From<lumenav_core::ConfigError> for LayoutError {
    fn from(error: lumenav_core::ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}
