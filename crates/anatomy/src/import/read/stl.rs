//! STL: 80 bytes of header, a count, 50 bytes per triangle (little endian); or text, `facet … vertex x y z …`.
//!
//! Binary is what has exactly the bytes its count promises: many binary files also begin with `solid`. Normals and
//! attributes are not used.

use super::{Problem, Soup, problem};
use nalgebra::Point3;

const HEADER: usize = 84;
const RECORD: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let promised = count(bytes);
    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    match promised {
        Some(count) if bytes.len() as u64 == HEADER as u64 + RECORD as u64 * u64::from(count) => {
            Ok(binary(bytes))
        }
        _ if is_text => text(bytes),
        Some(count) => {
            let whole = bytes.len().saturating_sub(HEADER) / RECORD;
            let place = format!("byte {}", bytes.len());
            let what = if whole < count as usize { "cut" } else { "too long" };
            Err(problem(place, format!("{what}: the header promises {count} triangles, {whole} are there")))
        }
        None => Err(problem(
            format!("byte {}", bytes.len()),
            "cut: neither a binary STL (84 bytes of header) nor a text that begins with `solid`",
        )),
    }
}

fn count(bytes: &[u8]) -> Option<u32> {
    let field: [u8; 4] = bytes.get(80..HEADER)?.try_into().ok()?;
    Some(u32::from_le_bytes(field))
}

fn binary(bytes: &[u8]) -> Soup {
    let mut soup = Soup::default();
    for record in bytes[HEADER..].chunks_exact(RECORD) {
        let first = soup.vertices.len() as u32;
        for corner in record[12..48].chunks_exact(12) {
            let number = |i: usize| {
                f64::from(f32::from_le_bytes([corner[i], corner[i + 1], corner[i + 2], corner[i + 3]]))
            };
            soup.vertices.push(Point3::new(number(0), number(4), number(8)));
        }
        soup.triangles.push([first, first + 1, first + 2]);
    }
    soup
}

fn text(bytes: &[u8]) -> Result<Soup, Problem> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        problem(format!("byte {}", error.valid_up_to()), "neither text nor a whole binary STL")
    })?;
    let mut soup = Soup::default();
    let mut facet = 0;
    let mut is_ended = false;
    for (line, words) in text.lines().enumerate() {
        let at = || format!("line {}", line + 1);
        let mut words = words.split_ascii_whitespace();
        match words.next() {
            Some("vertex") => {
                soup.vertices
                    .push(vertex(words).ok_or_else(|| problem(at(), "`vertex` needs three numbers"))?);
                facet += 1;
            }
            Some("endfacet") => {
                if facet != 3 {
                    return Err(problem(at(), format!("a facet of {facet} vertices; 3 are needed")));
                }
                let next = soup.vertices.len() as u32;
                soup.triangles.push([next - 3, next - 2, next - 1]);
                facet = 0;
            }
            Some("endsolid") => is_ended = true,
            _ => {}
        }
    }
    if facet != 0 || !is_ended {
        return Err(problem(
            format!("line {}", text.lines().count()),
            "cut: the text ends before `endsolid`",
        ));
    }
    Ok(soup)
}

fn vertex<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Point3<f64>> {
    let mut next = || words.next()?.parse().ok();
    Some(Point3::new(next()?, next()?, next()?))
}
