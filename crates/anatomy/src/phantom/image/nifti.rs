//! NIfTI-1 in one file (Cox et al. 2004, `nifti1.h`): 348 bytes of header, either byte order, numbers from `vox_offset` on.
//!
//! Places: `sform` where its code is set, else `qform`, else the voxels' sizes with the image's middle on the origin.

use super::{Element, Header, data_from};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::path::Path;

const HEADER_BYTES: usize = 348;

/// The header in its own byte order.
struct Fields {
    bytes: [u8; HEADER_BYTES],
    is_big_endian: bool,
}

impl Fields {
    fn i16(&self, at: usize) -> i16 {
        let b = [self.bytes[at], self.bytes[at + 1]];
        if self.is_big_endian { i16::from_be_bytes(b) } else { i16::from_le_bytes(b) }
    }

    fn f32(&self, at: usize) -> f64 {
        let b = [self.bytes[at], self.bytes[at + 1], self.bytes[at + 2], self.bytes[at + 3]];
        f64::from(if self.is_big_endian { f32::from_be_bytes(b) } else { f32::from_le_bytes(b) })
    }
}

pub(super) fn open(path: &Path) -> Result<Header, String> {
    let is_packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let mut bytes = [0; HEADER_BYTES];
    std::io::Read::read_exact(&mut data_from(path, 0, is_packed)?, &mut bytes)
        .map_err(|error| format!("no NIfTI-1 header: {error}"))?;
    let is_big_endian = match [bytes[0], bytes[1], bytes[2], bytes[3]] {
        [0x5c, 1, 0, 0] => false,
        [0, 0, 1, 0x5c] => true,
        _ => return Err("not NIfTI-1: the header's length is not 348".to_owned()),
    };
    if &bytes[344..348] != b"n+1\0" {
        return Err("not NIfTI-1 in one file (its last word must be `n+1`)".to_owned());
    }
    let fields = Fields { bytes, is_big_endian };
    let size = size(&fields)?;
    let element = match fields.i16(70) {
        2 => Element::U8,
        4 => Element::I16,
        8 => Element::I32,
        16 => Element::F32,
        64 => Element::F64,
        256 => Element::I8,
        512 => Element::U16,
        768 => Element::U32,
        other => {
            return Err(format!("numbers of NIfTI type {other}; allowed: 2, 4, 8, 16, 64, 256, 512, 768"));
        }
    };
    let unit_m = match fields.bytes[123] & 7 {
        1 => 1.0,
        3 => 1e-6,
        // 2 is mm; 0 is unknown, and everybody's unknown is mm.
        _ => 1e-3,
    };
    let offset = fields.f32(108);
    // The header and four bytes of extension come before; nobody's extension has a gigabyte.
    if !(352.0..=1e9).contains(&offset) || offset.fract() != 0.0 {
        return Err(format!("numbers from byte {offset} on; allowed: 352 to 1e9"));
    }
    let (edges, first) = places(&fields)?;
    // A slope of 0 means none.
    let slope = fields.f32(112);
    let (slope, intercept) = if slope == 0.0 { (1.0, 0.0) } else { (slope, fields.f32(116)) };
    Ok(Header {
        size,
        element,
        is_big_endian,
        slope,
        intercept,
        edges_m: edges * unit_m,
        first_m: first.map(|p| p * unit_m),
        is_lps: false,
        data: data_from(path, offset as u64, is_packed)?,
    })
}

fn size(fields: &Fields) -> Result<[usize; 3], String> {
    let dimensions = fields.i16(40);
    let mut size = [1_usize; 3];
    for i in 1..=7_i16 {
        let n = if i <= dimensions { fields.i16(40 + 2 * i as usize) } else { 1 };
        match size.get_mut(i as usize - 1) {
            Some(size) if n > 0 => *size = n as usize,
            None if n == 1 => {}
            _ => return Err(format!("{n} voxels along dimension {i}; a label image has three dimensions")),
        }
    }
    if !(2..=7).contains(&dimensions) {
        return Err(format!("{dimensions} dimensions; a label image has three"));
    }
    Ok(size)
}

fn places(fields: &Fields) -> Result<(Matrix3<f64>, Option<Vector3<f64>>), String> {
    let row = |at: usize| [0, 4, 8, 12].map(|k| fields.f32(at + k));
    if fields.i16(254) > 0 {
        let rows = [row(280), row(296), row(312)];
        let edges = Matrix3::from_fn(|r, c| rows[r][c]);
        return Ok((edges, Some(Vector3::from_fn(|r, _| rows[r][3]))));
    }
    let sizes = Vector3::new(fields.f32(80), fields.f32(84), fields.f32(88));
    if fields.i16(252) <= 0 {
        return Ok((Matrix3::from_diagonal(&sizes), None));
    }
    let [b, c, d] = [256, 260, 264].map(|at| fields.f32(at));
    let a2 = 1.0 - (b * b + c * c + d * d);
    if a2.is_nan() || a2 < -1e-5 {
        return Err("the quaternion of its places is longer than 1".to_owned());
    }
    let turn = UnitQuaternion::new_normalize(Quaternion::new(a2.max(0.0).sqrt(), b, c, d));
    // pixdim[0] tells whether the third axis is turned over; 0 counts as 1.
    let handed = Vector3::new(1.0, 1.0, if fields.f32(76) < 0.0 { -1.0 } else { 1.0 });
    let edges = turn.to_rotation_matrix().matrix() * Matrix3::from_diagonal(&sizes.component_mul(&handed));
    Ok((edges, Some(Vector3::new(fields.f32(268), fields.f32(272), fields.f32(276)))))
}
