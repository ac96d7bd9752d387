//! `models statistics`: figures of tracts beside those measured in people.

use anyhow::Context as _;
use lumenav::anatomy::statistics::TractStatistics;
use lumenav::anatomy::tract_file::{TractOptions, load};
use lumenav::core::Node;
use std::path::PathBuf;

pub(super) fn statistics(tracts: &[PathBuf]) -> anyhow::Result<()> {
    for path in tracts {
        let node = Node::open(path)?;
        let (tract, report) = load(&node, &TractOptions::default())
            .with_context(|| format!("{} is no tract", path.display()))?;
        let statistics = TractStatistics::of(&tract, &report);
        say!("{}\n{statistics}", path.display())?;
        let verdicts = statistics.verdicts();
        let outside = verdicts.iter().filter(|verdict| !verdict.inside()).count();
        verdicts.iter().try_for_each(|verdict| say!("{verdict}"))?;
        say!("{} of {} figures lie in their measured range\n", verdicts.len() - outside, verdicts.len())?;
    }
    Ok(())
}
