//! The map of a layout in three dimensions, with its elements, as a recording.

use super::Setting;
use lumenav::core::{LayoutElement, Primitive};
use lumenav::figures::viridis;
use lumenav::layouts::{Evaluation, Workspace};
use lumenav::recording::Still;
use std::fmt::Write as _;

/// Where there is no bound, as `0xRRGGBBAA`.
const NO_BOUND: u32 = 0x8080_8080;
const ELEMENT: u32 = 0xffff_ffff;
/// Length of an element's axes, m.
const AXIS_M: f32 = 0.02;
/// Of positions that stand alone.
const ALONE_M: f32 = 0.004;

/// Colours by the logarithm of the error, between these, m.
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    /// From the smallest to the 95th percentile: a few poor places would take all the colours.
    fn of(errors: &[f64]) -> Option<Self> {
        let mut known: Vec<f64> = errors.iter().copied().filter(|e| e.is_finite()).collect();
        known.sort_by(f64::total_cmp);
        let high =
            *known.get((0.95 * known.len() as f64).ceil() as usize - usize::from(!known.is_empty()))?;
        Some(Self { low: *known.first()?, high })
    }

    fn share(&self, error: f64) -> f64 {
        let width = (self.high / self.low).ln();
        if width > 0.0 { ((error / self.low).ln() / width).clamp(0.0, 1.0) } else { 0.0 }
    }

    fn colour(&self, error: f64) -> u32 {
        if !error.is_finite() {
            return NO_BOUND;
        }
        let [red, green, blue] = viridis(self.share(error));
        u32::from_be_bytes([red, green, blue, 255])
    }

    /// The legend as a table.
    fn legend(&self) -> String {
        let names = ["dark violet", "blue", "green", "yellow"];
        let mut text = "| colour | bound mm |\n|---|---|\n".to_owned();
        for (k, name) in names.iter().enumerate() {
            let share = k as f64 / (names.len() - 1) as f64;
            let error = self.low * (self.high / self.low).powf(share);
            let more = if k + 1 == names.len() { " and more" } else { "" };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "| {name} | {:.3}{more} |", 1e3 * error);
        }
        text + "| grey | infinite |\n"
    }
}

fn f32s([x, y, z]: [f64; 3]) -> [f32; 3] {
    [x as f32, y as f32, z as f32]
}

/// Half the least distance of neighbours on the grid, so that its points do not cover each other.
fn radius_m(workspace: &Workspace) -> f32 {
    let Some(grid) = &workspace.grid else { return ALONE_M };
    let steps = grid.axes_m.iter().flat_map(|axis| axis.windows(2).map(|pair| pair[1] - pair[0]));
    let least = steps.fold(f64::INFINITY, f64::min);
    if least.is_finite() { (0.3 * least) as f32 } else { ALONE_M }
}

/// The scene; `None` for a layout that sees nothing anywhere.
pub(super) fn still(
    setting: &Setting,
    workspace: &Workspace,
    evaluation: &Evaluation,
    elements: &[LayoutElement],
) -> Option<Still> {
    let directions = workspace.directions.len();
    let all: Vec<f64> = evaluation.errors_m().collect();
    let errors: Vec<f64> = all
        .chunks(directions)
        .map(|of| (of.iter().map(|e| e * e).sum::<f64>() / directions as f64).sqrt())
        .collect();
    let range = Range::of(&errors)?;
    let places: Vec<[f32; 3]> =
        elements.iter().map(|e| f32s(e.world_from_element.translation.vector.into())).collect();
    let map = Primitive::Points {
        path: "bound".to_owned(),
        positions_world_m: workspace.positions_m.iter().map(|p| f32s((*p).into())).collect(),
        rgba: errors.iter().map(|error| range.colour(*error)).collect(),
        radius_m: radius_m(workspace),
    };
    let points = Primitive::Points {
        path: "elements/places".to_owned(),
        positions_world_m: places.clone(),
        rgba: vec![ELEMENT],
        radius_m: 0.006,
    };
    // An element looks along its third axis: a magnetometer's z, a block's normal.
    let axis = |e: &LayoutElement| {
        f32s(e.world_from_element.rotation.transform_vector(&[0.0, 0.0, 1.0].into()).into())
            .map(|v| v * AXIS_M)
    };
    let arrows = Primitive::Arrows {
        path: "elements/axes".to_owned(),
        origins_world_m: places,
        vectors_m: elements.iter().map(axis).collect(),
        rgba: vec![ELEMENT],
    };
    let about = format!(
        "## {}\n\nBound of one reading of `{}`, root mean square over {directions} directions, at {} places.\n\n{}\n`{}`\n",
        setting.scenario,
        setting.sensor,
        workspace.positions_m.len(),
        range.legend(),
        setting.command,
    );
    let name = format!("{}, layout of {}", setting.scenario, setting.sensor);
    Some(Still { name, about, primitives: vec![map, points, arrows] })
}
