//! MetaImage (`.mha`, or `.mhd` with a file of numbers beside it): lines `key = value`, `ElementDataFile` last.

use super::{Element, Header, data_from, text_header};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

pub(super) fn open(path: &Path) -> Result<Header, String> {
    let key_of = |line: &str| line.split_once('=').map(|(key, _)| key.trim().to_owned());
    let (text, length) = text_header(path, |line| key_of(line).as_deref() == Some("ElementDataFile"))?;
    let mut keys = BTreeMap::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let (key, value) =
            line.split_once('=').ok_or_else(|| format!("`{}` is no line `key = value`", shown(line)))?;
        keys.insert(key.trim().to_owned(), value.trim().to_owned());
    }
    let get = |names: &[&str]| names.iter().find_map(|name| keys.get(*name)).map(String::as_str);
    let need = |name: &str| get(&[name]).ok_or_else(|| format!("the header has no `{name}`"));
    let is_set = |names: &[&str]| get(names).is_some_and(|v| v.eq_ignore_ascii_case("true"));
    if need("NDims")? != "3" {
        return Err(format!("{} dimensions; a label image has three", shown(need("NDims")?)));
    }
    let size = three::<usize>("DimSize", need("DimSize")?)?;
    let spacing = match get(&["ElementSpacing", "ElementSize"]) {
        Some(text) => three::<f64>("ElementSpacing", text)?,
        None => [1.0; 3],
    };
    let axes = match get(&["TransformMatrix", "Rotation", "Orientation"]) {
        Some(text) => Matrix3::from_column_slice(&numbers::<f64, 9>("TransformMatrix", text)?),
        None => Matrix3::identity(),
    };
    let first = match get(&["Offset", "Position", "Origin"]) {
        Some(text) => Vector3::from(three::<f64>("Offset", text)?),
        None => Vector3::zeros(),
    };
    if get(&["ElementNumberOfChannels"]).is_some_and(|n| n != "1") {
        return Err("more than one number per voxel".to_owned());
    }
    let element = element(need("ElementType")?)?;
    let file = need("ElementDataFile")?;
    let (place, skip) = match file {
        "LOCAL" => (path.to_owned(), length),
        "LIST" => return Err("lists of files are not read; save the image as one".to_owned()),
        name => (path.with_file_name("").join(name), 0),
    };
    let skip = skip
        + match get(&["HeaderSize"]) {
            Some(text) => text.parse::<u64>().map_err(|_| {
                format!("`HeaderSize = {}` is not read; allowed: a number of bytes", shown(text))
            })?,
            None => 0,
        };
    let data = data_from(&place, skip, false)?;
    let is_packed = is_set(&["CompressedData"]);
    Ok(Header {
        size,
        element,
        is_big_endian: is_set(&["ElementByteOrderMSB", "BinaryDataByteOrderMSB"]),
        slope: 1.0,
        intercept: 0.0,
        edges_m: axes * Matrix3::from_diagonal(&Vector3::from(spacing)) * 1e-3,
        first_m: Some(first * 1e-3),
        is_lps: true,
        data: if is_packed { Box::new(flate2::read::ZlibDecoder::new(data)) } else { data },
    })
}

fn element(name: &str) -> Result<Element, String> {
    Ok(match name {
        "MET_UCHAR" => Element::U8,
        "MET_CHAR" => Element::I8,
        "MET_USHORT" => Element::U16,
        "MET_SHORT" => Element::I16,
        "MET_UINT" => Element::U32,
        "MET_INT" => Element::I32,
        "MET_FLOAT" => Element::F32,
        "MET_DOUBLE" => Element::F64,
        other => {
            return Err(format!(
                "`ElementType = {}`; allowed: MET_UCHAR, CHAR, USHORT, SHORT, UINT, INT, FLOAT, DOUBLE",
                shown(other)
            ));
        }
    })
}

fn three<T: std::str::FromStr>(key: &str, text: &str) -> Result<[T; 3], String> {
    numbers::<T, 3>(key, text)
}

fn numbers<T: std::str::FromStr, const N: usize>(key: &str, text: &str) -> Result<[T; N], String> {
    let parsed: Option<Vec<T>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    parsed
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| format!("`{key} = {}` is not {N} numbers", shown(text)))
}

/// Text of a header for a message, shortened.
pub(super) fn shown(text: &str) -> String {
    text.chars().take(60).collect::<String>().escape_debug().to_string()
}
