//! Interfile 3.3 (`.h33` with `.i33`), as GATE reads voxel phantoms: lines `key := value`, `;` comments. No places: the middle of the
//! image is the origin.

use super::metaimage::shown;
use super::{Element, Header, data_from, text_header};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

pub(super) fn open(path: &Path) -> Result<Header, String> {
    let (text, _) = text_header(path, |_| false)?;
    let mut keys: BTreeMap<String, String> = BTreeMap::new();
    for line in text.lines() {
        let line = line.split(';').next().unwrap_or_default();
        if let Some((key, value)) = line.split_once(":=") {
            // Keys are told apart by letters and digits alone: programs differ in blanks, case and exclamation marks.
            let key =
                key.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase();
            keys.insert(key, value.trim().to_owned());
        }
    }
    if !keys.contains_key("interfile") {
        return Err("no Interfile: the header has no `!INTERFILE :=`".to_owned());
    }
    let get = |names: &[&str]| names.iter().find_map(|name| keys.get(*name)).filter(|v| !v.is_empty());
    let number = |said: &str, names: &[&str]| -> Result<f64, String> {
        let text = get(names).ok_or_else(|| format!("the header has no `{said}`"))?;
        text.parse().map_err(|_| format!("`{said} := {}` is no number", shown(text)))
    };
    let count = |said: &str, names: &[&str]| -> Result<usize, String> {
        let value = number(said, names)?;
        let is_count = value.fract() == 0.0 && (1.0..1e9).contains(&value);
        if is_count {
            Ok(value as usize)
        } else {
            Err(format!("`{said} := {value}`; allowed: a count from 1"))
        }
    };
    let size = [
        count("matrix size [1]", &["matrixsize1"])?,
        count("matrix size [2]", &["matrixsize2"])?,
        count(
            "number of slices",
            &["matrixsize3", "numberofslices", "totalnumberofimages", "numberofimages"],
        )?,
    ];
    let x_mm = number("scaling factor (mm/pixel) [1]", &["scalingfactormmpixel1"])?;
    let y_mm = number("scaling factor (mm/pixel) [2]", &["scalingfactormmpixel2"])?;
    // The standard counts a slice's thickness in pixels; GATE and others write millimetres under the same key. A thickness equal to
    // the pixel's is both; anything else must be said in millimetres.
    let z_mm = if get(&["scalingfactormmpixel3"]).is_some() {
        number("scaling factor (mm/pixel) [3]", &["scalingfactormmpixel3"])?
    } else {
        let thickness = number("slice thickness (pixels)", &["slicethicknesspixels"])?;
        if thickness != x_mm && thickness != 1.0 {
            return Err(format!(
                "`slice thickness (pixels) := {thickness}`: pixels or mm? give `scaling factor (mm/pixel) [3]`"
            ));
        }
        x_mm
    };
    let format = get(&["numberformat"]).map_or("unsigned integer", String::as_str).to_ascii_lowercase();
    let bytes = count("number of bytes per pixel", &["numberofbytesperpixel"])?;
    let element = match (format.as_str(), bytes) {
        ("unsigned integer", 1) => Element::U8,
        ("unsigned integer", 2) => Element::U16,
        ("unsigned integer", 4) => Element::U32,
        ("signed integer", 1) => Element::I8,
        ("signed integer", 2) => Element::I16,
        ("signed integer", 4) => Element::I32,
        ("short float" | "float", 4) => Element::F32,
        ("long float" | "float", 8) => Element::F64,
        _ => return Err(format!("numbers of kind `{}` of {bytes} bytes are not read", shown(&format))),
    };
    let skip = match get(&["dataoffsetinbytes"]) {
        Some(_) => number("data offset in bytes", &["dataoffsetinbytes"])?.clamp(0.0, 1e12) as u64,
        None => 0,
    };
    let file = get(&["nameofdatafile"]).ok_or("the header has no `name of data file`")?;
    // The standard's default is big-endian.
    let order = get(&["imagedatabyteorder"]).map_or("BIGENDIAN", String::as_str);
    Ok(Header {
        size,
        element,
        is_big_endian: !order.eq_ignore_ascii_case("LITTLEENDIAN"),
        slope: 1.0,
        intercept: 0.0,
        edges_m: Matrix3::from_diagonal(&Vector3::new(x_mm, y_mm, z_mm)) * 1e-3,
        first_m: None,
        is_lps: true,
        data: data_from(&path.with_file_name("").join(file), skip, false)?,
    })
}
