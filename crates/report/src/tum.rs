//! Trajectories as text: TUM (what `evo` reads), KITTI.
//!
//! ```text
//! TUM:    t_s x_m y_m z_m qx qy qz qw      one pose a line, world_from_capsule, scalar last, time increasing, `#` comments
//! KITTI:  the upper 3 x 4 of the matrix world_from_capsule, row by row: 12 numbers, no time
//! ```
//!
//! The observer writes `truth.tum` and `<track>.tum`. Times are exact to the nanosecond, other numbers have 12 decimals.
//! Where two estimates have one time the later replaces the earlier; one that is older than the last one written cannot
//! stand in the file and is counted in a comment at its end (`tracks.parquet` has them all). A track that estimates no
//! attitude has the identity.

use crate::error::ReportError;
use crate::file::{OutputFile, seconds_text};
use lumenav_core::{FixKind, Name, SimTime};
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use nalgebra::{Isometry3, UnitQuaternion};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A pose with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct StampedPose {
    /// The instant.
    pub at: SimTime,
    /// The pose.
    pub world_from_capsule: Isometry3<f64>,
}

impl StampedPose {
    /// Its line in a TUM file.
    pub fn tum_line(&self) -> String {
        let p = self.world_from_capsule.translation.vector;
        let q = UnitQuaternion::new_normalize(self.world_from_capsule.rotation.into_inner());
        format!(
            "{} {:.12} {:.12} {:.12} {:.12} {:.12} {:.12} {:.12}",
            seconds_text(self.at.0),
            p.x,
            p.y,
            p.z,
            q.i,
            q.j,
            q.k,
            q.w
        )
    }

    /// Its line in a TUM file with all digits of the numbers as they are: read back it is this pose.
    pub(crate) fn exact_tum_line(&self) -> String {
        let (p, q) = (self.world_from_capsule.translation.vector, self.world_from_capsule.rotation.coords);
        let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|v| format!("{v:?}"));
        format!("{} {}", seconds_text(self.at.0), numbers.join(" "))
    }

    /// Its line in a KITTI file.
    pub fn kitti_line(&self) -> String {
        let matrix = self.world_from_capsule.to_homogeneous();
        let mut numbers = Vec::with_capacity(12);
        for row in 0..3 {
            for column in 0..4 {
                numbers.push(format!("{:.12}", matrix[(row, column)]));
            }
        }
        numbers.join(" ")
    }

    fn is_finite(&self) -> bool {
        let pose = &self.world_from_capsule;
        pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
    }
}

/// One TUM file on its way.
struct TumFile {
    file: OutputFile,
    /// The last pose, held back until a later one comes.
    held: Option<StampedPose>,
    left_out: u64,
}

impl TumFile {
    fn create(path: &Path, who: &str) -> Result<Self, ReportError> {
        let mut file = OutputFile::in_place(path)?;
        file.line(&format!("# {who}: t_s x_m y_m z_m qx qy qz qw (world_from_capsule, scalar last)"))?;
        Ok(Self { file, held: None, left_out: 0 })
    }

    fn push(&mut self, pose: StampedPose) -> Result<(), ReportError> {
        let late = self.held.as_ref().is_some_and(|held| pose.at < held.at);
        if late || !pose.is_finite() {
            self.left_out += 1;
            return Ok(());
        }
        if let Some(held) = self.held.replace(pose)
            && self.held.as_ref().is_some_and(|now| now.at > held.at)
        {
            self.file.line(&held.tum_line())?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ReportError> {
        if let Some(held) = self.held.take() {
            self.file.line(&held.tum_line())?;
        }
        if self.left_out > 0 {
            self.file.line(&format!(
                "# {} poses left out: not finite, or older than the one before",
                self.left_out
            ))?;
        }
        self.file.finish()
    }
}

/// Writes `truth.tum` and `<track>.tum` into a folder.
pub struct TumObserver {
    folder: PathBuf,
    truth: Option<TumFile>,
    tracks: BTreeMap<Name, TumFile>,
}

impl TumObserver {
    /// Files go into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), truth: None, tracks: BTreeMap::new() }
    }

    fn open(&mut self, header: &RunHeader) -> Result<(), ReportError> {
        if header.has_truth {
            self.truth = Some(TumFile::create(&self.folder.join("truth.tum"), "truth")?);
        }
        for track in &header.tracks {
            // A track called like the truth's file must not overwrite it.
            let stem = if &*track.name == "truth" { "track-truth" } else { &*track.name };
            let path = self.folder.join(format!("{stem}.tum"));
            self.tracks.insert(track.name.clone(), TumFile::create(&path, &format!("track {}", track.name))?);
        }
        Ok(())
    }

    fn see(&mut self, event: &RunEvent<'_>) -> Result<(), ReportError> {
        match event {
            RunEvent::Truth(truth) => match &mut self.truth {
                Some(file) => {
                    file.push(StampedPose { at: truth.at, world_from_capsule: truth.world_from_capsule })
                }
                None => Ok(()),
            },
            RunEvent::Update(update) => {
                let Some(file) = self.tracks.get_mut(update.track) else { return Ok(()) };
                let mut world_from_capsule = update.estimate.pose.world_from_capsule;
                if update.estimate.pose.kind == FixKind::Position {
                    world_from_capsule.rotation = UnitQuaternion::identity();
                }
                file.push(StampedPose { at: update.estimate.at, world_from_capsule })
            }
            _ => Ok(()),
        }
    }
}

impl RunObserver for TumObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        self.open(header).map_err(|e| ObserverError::new("trajectories", e))
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.see(event).map_err(|e| ObserverError::new("trajectories", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.truth
            .iter_mut()
            .chain(self.tracks.values_mut())
            .try_for_each(TumFile::finish)
            .map_err(|e| ObserverError::new("trajectories", e))
    }
}

/// Writes poses as a TUM file, whole or not at all.
///
/// # Errors
/// [`ReportError::File`].
pub fn write_tum(path: &Path, poses: &[StampedPose]) -> Result<(), ReportError> {
    let mut file = OutputFile::beside(path)?;
    poses.iter().try_for_each(|pose| file.line(&pose.tum_line()))?;
    file.finish()
}

/// Writes poses as a KITTI file, whole or not at all.
///
/// # Errors
/// [`ReportError::File`].
pub fn write_kitti(path: &Path, poses: &[StampedPose]) -> Result<(), ReportError> {
    let mut file = OutputFile::beside(path)?;
    poses.iter().try_for_each(|pose| file.line(&pose.kitti_line()))?;
    file.finish()
}
