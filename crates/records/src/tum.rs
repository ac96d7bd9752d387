//! TUM trajectories: `t_s x y z qx qy qz qw`, metres, scalar last, `#` comments (the format that `evo` reads).

use crate::open;
use lumenav_core::{ModalityError, SimTime};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::io::{BufRead as _, BufReader};
use std::path::Path;

/// Reads a TUM file: strictly increasing times, eight finite numbers a row, quaternions of norm 1 within 1e-2.
///
/// # Errors
/// [`ModalityError::File`] or [`ModalityError::Row`] with file and line.
pub fn read(path: &Path) -> Result<Vec<(SimTime, Isometry3<f64>)>, ModalityError> {
    let file = path.display().to_string();
    let mut poses: Vec<(SimTime, Isometry3<f64>)> = Vec::new();
    for (index, line) in BufReader::new(open(path)?).lines().enumerate() {
        let line = line.map_err(|source| ModalityError::File { file: file.clone(), source })?;
        let refuse =
            |message: String| ModalityError::Row { file: file.clone(), line: index as u64 + 1, message };
        let text = line.split('#').next().unwrap_or_default().trim();
        if text.is_empty() {
            continue;
        }
        let pose = parse_row(text).map_err(refuse)?;
        if let Some((last, _)) = poses.last()
            && pose.0 <= *last
        {
            return Err(refuse(format!("time {} s does not increase", pose.0.seconds())));
        }
        poses.push(pose);
    }
    Ok(poses)
}

fn parse_row(text: &str) -> Result<(SimTime, Isometry3<f64>), String> {
    let cells: Vec<&str> = text.split_whitespace().collect();
    if cells.len() != 8 {
        return Err(format!("{} numbers; a TUM row has 8: t x y z qx qy qz qw", cells.len()));
    }
    let mut v = [0.0_f64; 8];
    for (value, cell) in v.iter_mut().zip(&cells) {
        *value = cell.parse().map_err(|_| format!("`{cell}` is not a number"))?;
        if !value.is_finite() {
            return Err(format!("`{cell}` is not finite"));
        }
    }
    if v[0].abs() > crate::place::MAX_TIME_S {
        return Err(format!("time {} s is out of range", v[0]));
    }
    let quaternion = Quaternion::new(v[7], v[4], v[5], v[6]);
    if (quaternion.norm() - 1.0).abs() > 1e-2 {
        return Err(format!("the quaternion's norm is {:.4}; it must be 1", quaternion.norm()));
    }
    let rotation = UnitQuaternion::new_normalize(quaternion);
    Ok((SimTime::from_seconds(v[0]), Isometry3::from_parts(Translation3::new(v[1], v[2], v[3]), rotation)))
}
