//! TUM trajectories: `t_s x y z qx qy qz qw`, metres, scalar last, `#` comments (the format that `evo` reads).

use crate::open;
use lumenav_core::{ModalityError, SimTime};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::io::{BufRead as _, BufReader};
use std::path::Path;

/// Reads a TUM file: strictly increasing times, eight finite numbers a row, quaternions of norm 1 within 1e-2. Times with up to nine
/// decimals are exact.
///
/// # Errors
/// [`ModalityError::File`] or [`ModalityError::Row`] with file and line.
pub fn read(path: &Path) -> Result<Vec<(SimTime, Isometry3<f64>)>, ModalityError> {
    let file = path.display().to_string();
    let mut poses: Vec<(SimTime, Isometry3<f64>)> = Vec::new();
    for (index, line) in BufReader::new(open(path)?).lines().enumerate() {
        let refuse =
            |message: String| ModalityError::Row { file: file.clone(), line: index as u64 + 1, message };
        let line = line.map_err(|error| refuse(format!("cannot be read as text: {error}")))?;
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
    let at =
        SimTime::parse_seconds(cells[0]).ok_or_else(|| format!("`{}` is not a time in seconds", cells[0]))?;
    if at.seconds().abs() > crate::place::MAX_TIME_S {
        return Err(format!("time {} s is out of range", cells[0]));
    }
    let mut v = [0.0_f64; 7];
    for (value, cell) in v.iter_mut().zip(&cells[1..]) {
        *value = cell.parse().map_err(|_| format!("`{cell}` is not a number"))?;
        if !value.is_finite() {
            return Err(format!("`{cell}` is not finite"));
        }
    }
    let quaternion = Quaternion::new(v[6], v[3], v[4], v[5]);
    if (quaternion.norm() - 1.0).abs() > 1e-2 {
        return Err(format!("the quaternion's norm is {:.4}; it must be 1", quaternion.norm()));
    }
    let rotation = UnitQuaternion::new_normalize(quaternion);
    Ok((at, Isometry3::from_parts(Translation3::new(v[0], v[1], v[2]), rotation)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_bad_line_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.tum");
        let good = "# comment\n0.0 0 0 0 0 0 0 1\n";
        for (line, what) in [
            ("1.0 0 0 0 0 0 0", "7 numbers; a TUM row has 8"),
            ("1.0 0 0 NaN 0 0 0 1", "`NaN` is not finite"),
            ("1.0 0 0 x 0 0 0 1", "`x` is not a number"),
            ("1.0 0 0 0 0 0 0 0", "norm is 0.0000; it must be 1"),
            ("0.0 0 0 0 0 0 0 1", "time 0 s does not increase"),
            ("nan 0 0 0 0 0 0 1", "`nan` is not a time in seconds"),
            ("5e9 0 0 0 0 0 0 1", "out of range"),
        ] {
            std::fs::write(&path, format!("{good}{line}\n")).unwrap();
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains("bad.tum:3: ") && error.contains(what), "{error}");
        }
        std::fs::write(&path, b"0.0 0 0 0 0 0 0 1\n\xff\xfe\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("bad.tum:2: cannot be read as text"));
    }

    #[test]
    fn closed_form_a_row_is_exact_to_the_nanosecond() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tum");
        std::fs::write(&path, "5.000000007 1 2 3 0 0 1 0 # turned about z\n").unwrap();
        let poses = read(&path).unwrap();
        assert_eq!(poses[0].0, SimTime(5_000_000_007));
        assert_eq!(poses[0].1.translation.vector, nalgebra::Vector3::new(1.0, 2.0, 3.0));
        assert!((poses[0].1.rotation.angle() - std::f64::consts::PI).abs() < 1e-12);
    }
}
