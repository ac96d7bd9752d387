//! An observer that keeps the position error of each track.

use lumenav::pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use std::collections::BTreeMap;

/// Position error of one track.
#[derive(Clone, Copy, Debug, Default)]
pub struct OfTrack {
    /// Estimates compared with the truth.
    pub judged: u64,
    /// Sum of their errors, mm.
    sum_mm: f64,
    /// The largest, mm.
    pub worst_mm: f64,
}

impl OfTrack {
    /// Mean error, mm; not a number before the first estimate.
    pub fn mean_mm(&self) -> f64 {
        self.sum_mm / self.judged as f64
    }
}

/// All tracks by name.
#[derive(Debug, Default)]
pub struct TrackErrors {
    /// The tracks.
    pub tracks: BTreeMap<String, OfTrack>,
}

impl RunObserver for TrackErrors {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        self.tracks = header.tracks.iter().map(|t| (t.name.to_string(), OfTrack::default())).collect();
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        let RunEvent::Update(update) = event else { return Ok(()) };
        // A late reading revises what was judged already.
        let Some(error) = update.error.filter(|_| !update.revision) else { return Ok(()) };
        if let Some(of) = self.tracks.get_mut(&**update.track) {
            let error_mm = 1e3 * error.position_world_m.norm();
            of.judged += 1;
            of.sum_mm += error_mm;
            of.worst_mm = of.worst_mm.max(error_mm);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        Ok(())
    }
}
