//! Wavefront OBJ: `v x y z` and `f a b c …` with indices from 1, or negative from the last; `a/t/n` names a vertex by `a`.
//! Everything else is not geometry and not used.

use super::{Problem, Soup, problem, push_polygon};
use nalgebra::Point3;

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let text = std::str::from_utf8(bytes)
        .map_err(|error| problem(format!("byte {}", error.valid_up_to()), "an OBJ is text"))?;
    let mut soup = Soup::default();
    for (line, words) in text.lines().enumerate() {
        let at = || format!("line {}", line + 1);
        let mut words = words.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                let [x, y, z, ..] = numbers[..] else {
                    return Err(problem(at(), "`v` needs three numbers"));
                };
                soup.vertices.push(Point3::new(x, y, z));
            }
            Some("f") => {
                let corners: Option<Vec<u32>> = words.map(|word| index(word, soup.vertices.len())).collect();
                match corners {
                    Some(corners) if corners.len() >= 3 => push_polygon(&mut soup.triangles, &corners),
                    _ => return Err(problem(at(), "`f` needs three or more vertices that came before")),
                }
            }
            _ => {}
        }
    }
    Ok(soup)
}

/// Index from 0 of a corner such as `7`, `7/1/3` or `-1`.
fn index(word: &str, count: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let count = i64::try_from(count).ok()?;
    let index = if number < 0 { count + number } else { number - 1 };
    (0..count).contains(&index).then_some(index as u32)
}
