//! The tract file of an import: points in the surface's own frame, and how they came about.

use super::ImportedTract;
use nalgebra::Vector3;
use std::fmt::Write as _;
use std::path::Path;

/// Where the numbers of an import come from, in one line.
pub(super) fn source(file: &str, sha256: &str) -> String {
    let name =
        Path::new(file).file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    format!("imported from {name} (SHA-256 {sha256}) by lumenav {}", env!("CARGO_PKG_VERSION"))
}

/// The text of a tract file that [`crate::tract_file`] reads, `centred`: with the middle of its box at the origin. `made_by`: the command, for whoever wants
/// to repeat it.
pub fn tract_file_text(imported: &ImportedTract, made_by: &str, centred: bool) -> String {
    let mut text = String::new();
    let mut line = |words: &str| {
        text.push_str(words);
        text.push('\n');
    };
    line(&format!("# Made by: {}", one_line(made_by)));
    line(&format!(
        "# Method: {} triangles, voxels of {:.3} mm, cheapest way by (radius / clearance)^6, sections of 24 rays, parabolas of 5 mm, \
         stations every 2 mm; radius: median of the rays.",
        imported.triangles,
        1e3 * imported.voxel_m
    ));
    line(&format!("# Repairs ({}), places in mm of the surface's frame:", imported.repairs.len()));
    imported.repairs.iter().for_each(|repair| line(&format!("#   {repair}")));
    line(&format!("# Warnings ({}):", imported.warnings.len()));
    imported.warnings.iter().for_each(|warning| line(&format!("#   {}", one_line(warning))));
    let moved_m = if centred { -Vector3::from(imported.middle_m()) } else { Vector3::zeros() };
    if centred {
        let by = moved_m * 1e3;
        line(&format!(
            "# Moved by {:.1}, {:.1}, {:.1} mm (torso axes) from the surface's frame.",
            by.x, by.y, by.z
        ));
    }
    line("\n[tract]");
    line(&format!("frame = {:?}", imported.axes.as_str()));
    line(&format!("name = {}", quoted(&imported.draft.name)));
    line(&format!("source = {}", quoted(&imported.draft.source)));
    line("ends = [\"closed\", \"exit\"]");
    for segment in &imported.draft.segments {
        line("\n[[tract.segment]]");
        line(&format!("name = {:?}", segment.key.as_str()));
        line("points_mm = [ # x, y, z, radius");
        for (point, radius) in segment.points_m.iter().zip(&segment.radii_m) {
            let p = imported.axes.torso_from_file(*point + moved_m) * 1e3;
            line(&format!("  [{:.3}, {:.3}, {:.3}, {:.3}],", p.x, p.y, p.z, 1e3 * radius));
        }
        line("]");
    }
    text
}

fn one_line(words: &str) -> String {
    words.replace(['\n', '\r'], " ")
}

/// A TOML basic string.
fn quoted(words: &str) -> String {
    let mut text = String::from("\"");
    for c in words.chars() {
        match c {
            '"' | '\\' => text.extend(['\\', c]),
            c if c.is_control() => {
                // Writing to a string does not fail.
                let _ = write!(text, "\\u{:04X}", u32::from(c));
            }
            c => text.push(c),
        }
    }
    text.push('"');
    text
}
