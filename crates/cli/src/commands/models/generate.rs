//! `models generate tract`: a whole gut from a seed, as a tract file.

use crate::args::GenerateTract;
use crate::exit::WrongFiles;
use crate::files;
use anyhow::Context as _;
use lumenav::anatomy::generator::{BodySize, WholeGutRequest, tract_file_text, whole_gut};
use lumenav::anatomy::statistics::TractStatistics;
use lumenav::core::RandomStreams;

pub(super) fn tract(options: &GenerateTract) -> anyhow::Result<()> {
    let size = BodySize::from_name(&options.size).with_context(|| {
        let sizes = BodySize::ALL.map(BodySize::as_str).join(", ");
        format!("no size `{}`; allowed: {sizes}", options.size)
    })?;
    let request =
        WholeGutRequest { size, length_scale: options.length_scale, radius_scale: options.radius_scale };
    let (folder, name) = files::folder_and_name(&options.out)?;
    files::check_free(&folder, &[&name], options.force)?;
    let generated = whole_gut(&request, &RandomStreams::new(options.seed, 0, "whole-gut"))
        .map_err(|refused| WrongFiles(format!("seed {}: {refused}", options.seed)))?;
    let made_by = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let text = tract_file_text(&generated.draft, &format!("lumenav {made_by}"));
    let written = files::write(&folder, &[(&name, text)])?;
    say!("{}", TractStatistics::of(&generated.tract, &generated.report))?;
    say!("{} attempts", generated.attempts)?;
    written.iter().try_for_each(|path| say!("{}", path.display()))
}
