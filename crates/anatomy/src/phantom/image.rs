//! Label images: a number per voxel, and a table that says what it is.
//!
//! | ending | format | places |
//! |---|---|---|
//! | `.nii`, `.nii.gz` | [`nifti`], version 1 | RAS+ by the file's affine map |
//! | `.mhd`, `.mha` | [`metaimage`] | LPS, as ITK writes them |
//! | `.h33`, `.hdr` | [`interfile`], the pair with `.i33` that GATE reads | none: the middle of the image is the origin |
//!
//! Small readers of our own: what is needed is a size, a map and numbers, and a header that lies must cost neither memory nor a panic.
//! Memory grows with the numbers that are there, not with what a header promises.

pub mod interfile;
pub mod metaimage;
pub mod nifti;

use super::torso::MAX_VOXELS;
use super::voxels::OUTSIDE;
use super::{MaterialTable, VoxelGrid};
use lumenav_core::config::quantity::Finite;
use lumenav_core::{ConfigError, Node};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// `[phantom]` of kind `voxels`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VoxelsTable {
    pub(crate) name: String,
    source: String,
    /// The image.
    file: String,
    /// Axes of the image's places; absent: as its format has them.
    axes: Option<Axes>,
    /// Where the middle of the image stands, mm; absent: where the file says.
    centre_mm: Option<[Finite; 3]>,
    /// Labels without material: the air around the body.
    #[serde(default = "zero")]
    outside: Vec<i64>,
    /// What the other labels are.
    tissue: Vec<TissueTable>,
}

fn zero() -> Vec<i64> {
    vec![0]
}

/// `[[phantom.tissue]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TissueTable {
    labels: Vec<i64>,
    material: MaterialTable,
}

/// Which way an image's axes point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Axes {
    /// Right, anterior, superior.
    Ras,
    /// Left, posterior, superior.
    Lps,
}

/// Type of a stored number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Element {
    fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in so many bytes, last byte first.
    fn value(self, b: &[u8]) -> f64 {
        match (self, b) {
            (Self::U8, [a]) => f64::from(*a),
            (Self::I8, [a]) => f64::from(*a as i8),
            (Self::U16, [a, b]) => f64::from(u16::from_le_bytes([*a, *b])),
            (Self::I16, [a, b]) => f64::from(i16::from_le_bytes([*a, *b])),
            (Self::U32, [a, b, c, d]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
            (Self::I32, [a, b, c, d]) => f64::from(i32::from_le_bytes([*a, *b, *c, *d])),
            (Self::F32, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            (Self::F64, b) => b.try_into().map_or(f64::NAN, f64::from_le_bytes),
            _ => f64::NAN,
        }
    }
}

/// An image whose header was read; its numbers come next.
pub(crate) struct Header {
    pub(crate) size: [usize; 3],
    pub(crate) element: Element,
    pub(crate) is_big_endian: bool,
    /// A label is `slope · number + intercept`.
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
    /// Columns: the voxels' edges, m.
    pub(crate) edges_m: Matrix3<f64>,
    /// Middle of the first voxel, m; `None` puts the middle of the image on the origin.
    pub(crate) first_m: Option<Vector3<f64>>,
    /// Whether x and y are those of LPS.
    pub(crate) is_lps: bool,
    pub(crate) data: Box<dyn Read>,
}

/// No voxel is larger, m.
const MAX_VOXEL_M: f64 = 0.1;
/// No image stands further away, m.
const MAX_PLACE_M: f64 = 10.0;

impl VoxelsTable {
    pub(crate) fn grid(&self, node: &Node) -> Result<VoxelGrid, ConfigError> {
        let path = node.existing_path("file", &self.file)?;
        let refuse = |message: String| node.error_at("file", &format!("{}: {message}", path.display()));
        let mut materials = Vec::new();
        let mut material_of: BTreeMap<i64, u8> = self.outside.iter().map(|label| (*label, OUTSIDE)).collect();
        for tissue in &self.tissue {
            for label in &tissue.labels {
                if material_of.insert(*label, materials.len() as u8).is_some() {
                    return Err(node.error_at("tissue", &format!("label {label} stands there twice")));
                }
            }
            materials.push(tissue.material.material());
            if materials.len() >= usize::from(OUTSIDE) {
                return Err(node.error_at("tissue", "allowed: at most 254 tissues"));
            }
        }
        let mut header = open(&path).map_err(&refuse)?;
        header.check().map_err(&refuse)?;
        let voxels = header.labels(&material_of).map_err(&refuse)?;
        let is_lps = self.axes.map_or(header.is_lps, |axes| axes == Axes::Lps);
        let flip = Vector3::new(if is_lps { -1.0 } else { 1.0 }, if is_lps { -1.0 } else { 1.0 }, 1.0);
        let edges = Matrix3::from_diagonal(&flip) * header.edges_m;
        let half = edges * Vector3::from(header.size.map(|n| 0.5 * n as f64));
        let corner = match (&self.centre_mm, header.first_m) {
            (Some(centre), _) => Vector3::from(centre.map(|v| v.0 * 1e-3)) - half,
            (None, Some(first)) => first.component_mul(&flip) - edges * Vector3::repeat(0.5),
            (None, None) => -half,
        };
        VoxelGrid::new(header.size, &edges, &corner, materials, voxels)
            .map_err(|error| refuse(error.to_string()))
    }
}

pub(crate) fn open(path: &Path) -> Result<Header, String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let ends = |ending: &str| name.ends_with(ending);
    if ends(".nii") || ends(".nii.gz") {
        nifti::open(path)
    } else if ends(".mhd") || ends(".mha") {
        metaimage::open(path)
    } else if ends(".h33") || ends(".hdr") {
        interfile::open(path)
    } else {
        Err("no label image; allowed: .nii, .nii.gz, .mhd, .mha, .h33, .hdr".to_owned())
    }
}

/// A file from a place on, unpacked where its name says so.
fn data_from(path: &Path, skip: u64, is_packed: bool) -> Result<Box<dyn Read>, String> {
    let file = File::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut reader: Box<dyn Read> = Box::new(BufReader::new(file));
    if is_packed {
        reader = Box::new(flate2::read::MultiGzDecoder::new(reader));
    }
    let passed = std::io::copy(&mut reader.by_ref().take(skip), &mut std::io::sink());
    match passed {
        Ok(passed) if passed == skip => Ok(reader),
        Ok(_) => Err("the file ends before its numbers begin".to_owned()),
        Err(error) => Err(format!("cannot be read: {error}")),
    }
}

/// The lines of a text header: everything up to a line that `is_last`, at most 64 KiB.
fn text_header(path: &Path, is_last: impl Fn(&str) -> bool) -> Result<(String, u64), String> {
    const MOST: u64 = 64 * 1024;
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    file.take(MOST).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    let (mut text, mut length) = (String::new(), 0);
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        length += line.len() as u64;
        let line = std::str::from_utf8(line).map_err(|_| "the header is no text".to_owned())?;
        text.push_str(line);
        if is_last(line) {
            break;
        }
    }
    Ok((text, length))
}

impl Header {
    pub(crate) fn check(&self) -> Result<(), String> {
        let count = self.size.iter().try_fold(1_usize, |n, s| n.checked_mul(*s));
        if count.is_none_or(|n| n == 0 || n > MAX_VOXELS) {
            return Err(format!("{:?} voxels; allowed: 1 to {MAX_VOXELS} in all", self.size));
        }
        let edges = self.edges_m.column_iter().all(|e| e.norm() > 0.0 && e.norm() <= MAX_VOXEL_M);
        if !edges {
            return Err(format!("voxels of no size, or of more than {} mm", MAX_VOXEL_M * 1e3));
        }
        let volume: f64 = self.edges_m.column_iter().map(|e| e.norm()).product();
        if self.edges_m.determinant().abs() < 1e-6 * volume {
            return Err("voxels whose edges lie in one plane".to_owned());
        }
        if self.first_m.is_some_and(|p| !p.iter().all(|v| v.abs() <= MAX_PLACE_M)) {
            return Err(format!("an image more than {MAX_PLACE_M} m from its origin"));
        }
        if !self.slope.is_finite() || !self.intercept.is_finite() || self.slope == 0.0 {
            return Err("numbers scaled by zero, or by what is no number".to_owned());
        }
        Ok(())
    }

    /// Material per voxel.
    fn labels(&mut self, material_of: &BTreeMap<i64, u8>) -> Result<Vec<u8>, String> {
        let size = self.size;
        let mut voxels: Vec<u8> = Vec::new();
        let mut last: Option<(i64, u8)> = None;
        self.each_label(|label| {
            let material = match last {
                Some((same, material)) if same == label => material,
                _ => material(label, material_of)
                    .map_err(|told| format!("{} {told}", place(size, voxels.len())))?,
            };
            last = Some((label, material));
            voxels.push(material);
            Ok(())
        })?;
        Ok(voxels)
    }

    /// Hands over every voxel's label, in the order of the file.
    pub(crate) fn each_label(
        &mut self,
        mut take: impl FnMut(i64) -> Result<(), String>,
    ) -> Result<(), String> {
        let count: usize = self.size.iter().product();
        let size = self.element.bytes();
        let mut buffer = vec![0; 4096 * size];
        let mut done = 0;
        while done < count {
            let part = &mut buffer[..size * (count - done).min(4096)];
            self.data.read_exact(part).map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => {
                    format!("cut: fewer than {count} voxels of {size} bytes")
                }
                _ => format!("cannot be read after {done} voxels: {error}"),
            })?;
            for bytes in part.chunks_exact_mut(size) {
                if self.is_big_endian {
                    bytes.reverse();
                }
                let number = self.element.value(bytes) * self.slope + self.intercept;
                if number.is_nan() || number.fract() != 0.0 || number.abs() > 1e15 {
                    let at = place(self.size, done);
                    return Err(format!("{at} holds {number}; a whole number is a label"));
                }
                take(number as i64)?;
                done += 1;
            }
        }
        Ok(())
    }
}

fn place([nx, ny, _]: [usize; 3], voxel: usize) -> String {
    format!("voxel ({}, {}, {})", voxel % nx, voxel / nx % ny, voxel / (nx * ny))
}

fn material(label: i64, material_of: &BTreeMap<i64, u8>) -> Result<u8, String> {
    let known = || material_of.keys().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let unknown = || format!("holds label {label}, which no tissue has; the table has: {}", known());
    material_of.get(&label).copied().ok_or_else(unknown)
}
