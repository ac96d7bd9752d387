//! What there is to reproduce.

use crate::context::{Context, Size};
use crate::{ReproduceError, Table, gut, moussakhani2012, than2015};

/// A published table or figure that can be run again.
#[derive(Clone, Copy, Debug)]
pub struct Reproduction {
    /// `<publication>/<table>`.
    pub id: &'static str,
    /// Publication and number of the table or figure.
    pub source: &'static str,
    /// What it is about, in a line.
    pub about: &'static str,
    /// The seeds of the published run of ours; empty where nothing is drawn.
    pub default_seeds: &'static [u64],
    pub(crate) run: fn(&Context<'_>, Table) -> Result<Table, ReproduceError>,
}

impl Reproduction {
    /// The seeds to use: those asked for, else the default ones (quick: the first of them).
    pub fn seeds(&self, asked: Option<&[u64]>, size: Size) -> Vec<u64> {
        let all = asked.unwrap_or(self.default_seeds);
        let count = if asked.is_none() { size.pick(all.len(), all.len().min(1)) } else { all.len() };
        all[..count].to_vec()
    }

    /// Runs it.
    ///
    /// # Errors
    /// [`ReproduceError`].
    pub fn run(&self, context: &Context<'_>) -> Result<Table, ReproduceError> {
        if context.seeds.is_empty() && !self.default_seeds.is_empty() {
            return Err(ReproduceError::NoSeed);
        }
        let seeds: &[u64] = if self.default_seeds.is_empty() { &[] } else { &context.seeds };
        let mut table = Table::new(self.id, self.source, seeds);
        if context.size == Size::Quick {
            table.note("quick: a fraction of the windows; a look at the figures, not a reproduction");
        }
        (self.run)(context, table)
    }
}

/// All of them, sorted by id.
pub fn all() -> Vec<Reproduction> {
    let mut all = [gut::ALL, moussakhani2012::ALL, than2015::ALL].concat();
    all.sort_by_key(|reproduction| reproduction.id);
    all
}

/// The one with this id.
pub fn find(id: &str) -> Option<Reproduction> {
    all().into_iter().find(|reproduction| reproduction.id == id)
}
