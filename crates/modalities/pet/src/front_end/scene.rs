//! What a front end shows of a window: its lines by what they were taken for, and the markers.

use crate::line::Line;
use crate::tracking::Role;
use lumenav_core::Primitive;
use nalgebra::Vector3;

/// Colour of a line by what it was taken for, `0xRRGGBBAA`: markers in colours that the colour-blind can tell apart (Okabe and Ito
/// 2008), what is not theirs in greys.
fn line_colour(role: Role) -> u32 {
    const MARKERS: [u32; 6] = [0xe69f_00ff, 0x56b4_e9ff, 0x009e_73ff, 0xf0e4_42ff, 0xd55e_00ff, 0xcc79_a7ff];
    match role {
        Role::Marker(i) => MARKERS[usize::from(i) % MARKERS.len()],
        Role::Background => 0x8080_8050,
        Role::Dropped => 0xa040_4060,
        Role::Unused => 0x4040_4040,
    }
}

/// Half the length of a line as drawn, m: the markers' neighbourhood, not the whole scanner.
const DRAWN_HALF_LENGTH_M: f64 = 0.06;
/// At most so many lines are drawn: a picture of more is a ball of wool, and a recording has a size to keep.
const MOST_DRAWN: usize = 120;

/// The window's lines near a centre, coloured by what the tracker took them for.
pub(super) fn lines(lines: &[Line], roles: &[Role], centre: &Vector3<f64>) -> Primitive {
    let every = lines.len().div_ceil(MOST_DRAWN).max(1);
    let (mut strips, mut rgba) = (Vec::new(), Vec::new());
    for (i, line) in lines.iter().enumerate().step_by(every) {
        let Some(along) = line.direction() else { continue };
        let nearest = line.ends_world_m[0] + along.into_inner() * along.dot(&(centre - line.ends_world_m[0]));
        let end = |sign: f64| {
            (nearest + along.into_inner() * (sign * DRAWN_HALF_LENGTH_M)).map(|v| v as f32).into()
        };
        strips.push(vec![end(-1.0), end(1.0)]);
        rgba.push(line_colour(roles.get(i).copied().unwrap_or(Role::Unused)));
    }
    Primitive::Lines { path: "lines".to_owned(), strips_world_m: strips, rgba }
}

/// The markers, in the colours of their lines.
pub(super) fn markers(places: &[Vector3<f64>]) -> Primitive {
    Primitive::Points {
        path: "markers".to_owned(),
        positions_world_m: places.iter().map(|m| m.map(|v| v as f32).into()).collect(),
        rgba: (0..places.len()).map(|i| line_colour(Role::Marker(i as u8))).collect(),
        radius_m: 1.2e-3,
    }
}
