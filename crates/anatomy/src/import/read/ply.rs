//! PLY 1.0: a text header that lists elements and their properties, then text or binary (either byte order).
//!
//! Used are `x`, `y`, `z` of `vertex` and the list `vertex_indices` (or `vertex_index`) of `face`; the rest is passed over.

use super::{Problem, Soup, problem, push_polygon};
use nalgebra::Point3;

/// A header is short.
const MAX_HEADER_BYTES: usize = 64 * 1024;
/// A face has at most so many corners.
const MAX_CORNERS: f64 = 1024.0;

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

struct Property {
    name: String,
    kind: Kind,
    /// Type of the count, for lists.
    count: Option<Kind>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Clone, Copy, PartialEq)]
enum Coding {
    Text,
    Little,
    Big,
}

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let (coding, elements, start) = header(bytes)?;
    let mut values = Values { coding, bytes, at: start };
    let mut soup = Soup::default();
    for element in &elements {
        for row in 0..element.count {
            let cut =
                || problem(format!("{} {}", element.name, row + 1), "cut, or no number where one is due");
            values.row(element, &mut soup).ok_or_else(cut)?;
        }
    }
    Ok(soup)
}

fn header(bytes: &[u8]) -> Result<(Coding, Vec<Element>, usize), Problem> {
    let (mut coding, mut elements, mut at) = (None, Vec::<Element>::new(), 0);
    for (number, line) in
        bytes[..bytes.len().min(MAX_HEADER_BYTES)].split_inclusive(|b| *b == b'\n').enumerate()
    {
        at += line.len();
        let place = format!("line {}", number + 1);
        let line = std::str::from_utf8(line).map_err(|_| problem(&place, "the header is no text"))?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match (number, &words[..]) {
            (0, ["ply"]) | (_, ["comment" | "obj_info", ..] | []) => {}
            (0, _) => return Err(problem(place, "a PLY begins with `ply`")),
            (_, ["format", "ascii", _]) => coding = Some(Coding::Text),
            (_, ["format", "binary_little_endian", _]) => coding = Some(Coding::Little),
            (_, ["format", "binary_big_endian", _]) => coding = Some(Coding::Big),
            (_, ["element", name, count]) => {
                let count = count.parse().map_err(|_| problem(&place, "an element's count is no number"))?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            (_, ["property", rest @ ..]) => {
                let property = property(rest).ok_or_else(|| problem(&place, "an unknown property type"))?;
                let element =
                    elements.last_mut().ok_or_else(|| problem(&place, "a property of no element"))?;
                element.properties.push(property);
            }
            (_, ["end_header"]) => {
                let coding = coding.ok_or_else(|| problem(place, "the header states no format"))?;
                return Ok((coding, elements, at));
            }
            _ => return Err(problem(place, "not understood in a PLY header")),
        }
    }
    Err(problem(format!("byte {at}"), "the header does not end (`end_header`)"))
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", count, kind, name] => {
            Some(Property { name: (*name).to_owned(), kind: kind_of(kind)?, count: Some(kind_of(count)?) })
        }
        [kind, name] => Some(Property { name: (*name).to_owned(), kind: kind_of(kind)?, count: None }),
        _ => None,
    }
}

fn kind_of(word: &str) -> Option<Kind> {
    Some(match word {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

/// Numbers one after the other.
struct Values<'a> {
    coding: Coding,
    bytes: &'a [u8],
    at: usize,
}

impl Values<'_> {
    /// Reads one row of an element into the soup; `None` where the file is cut.
    fn row(&mut self, element: &Element, soup: &mut Soup) -> Option<()> {
        let mut place = [None; 3];
        for property in &element.properties {
            let Some(count) = property.count else {
                let value = self.next(property.kind)?;
                if let Some(axis) = ["x", "y", "z"].iter().position(|name| *name == property.name) {
                    place[axis] = Some(value);
                }
                continue;
            };
            let count = self.next(count).filter(|n| (0.0..=MAX_CORNERS).contains(n))?;
            let mut corners = Vec::new();
            for _ in 0..count as usize {
                let value = self.next(property.kind)?;
                corners.push(if value >= 0.0 { value as u32 } else { u32::MAX });
            }
            if element.name == "face" && matches!(&property.name[..], "vertex_indices" | "vertex_index") {
                push_polygon(&mut soup.triangles, &corners);
            }
        }
        if element.name == "vertex" {
            soup.vertices.push(Point3::new(place[0]?, place[1]?, place[2]?));
        } else if element.properties.is_empty() {
            // An element without properties has no bytes: a count of 2^60 of them must not be walked through.
            return None;
        }
        Some(())
    }

    fn next(&mut self, kind: Kind) -> Option<f64> {
        if self.coding == Coding::Text {
            let rest = self.bytes.get(self.at..)?;
            let skip = rest.iter().position(|b| !b.is_ascii_whitespace())?;
            let length = rest[skip..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - skip);
            self.at += skip + length;
            return std::str::from_utf8(&rest[skip..skip + length]).ok()?.parse().ok();
        }
        let size = match kind {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::F64 => 8,
        };
        let mut field = [0; 8];
        field[..size].copy_from_slice(self.bytes.get(self.at..self.at + size)?);
        if self.coding == Coding::Big {
            field[..size].reverse();
        }
        self.at += size;
        let [a, b, c, d, ..] = field;
        Some(match kind {
            Kind::I8 => f64::from(a as i8),
            Kind::U8 => f64::from(a),
            Kind::I16 => f64::from(i16::from_le_bytes([a, b])),
            Kind::U16 => f64::from(u16::from_le_bytes([a, b])),
            Kind::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Kind::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Kind::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Kind::F64 => f64::from_le_bytes(field),
        })
    }
}
