//! A picture in three dimensions without a course in time: the map of a layout, with its sensors.

use crate::blueprint::{self, Layout};
use crate::error::RecordingError;
use crate::output::Output;
use crate::primitives::{components, extent_points_m, path};
use crate::store::{Store, entity};
use lumenav_core::Primitive;
use lumenav_pipeline::SceneOwner;
use rerun::external::re_log_types::TimePoint;
use rerun::{EntityPath, StoreId};
use std::path::Path;

/// What is drawn.
#[derive(Clone, Debug)]
pub struct Still {
    /// Name of the recording; two of one name are one to the viewer.
    pub name: String,
    /// What stands beside the scene, Markdown.
    pub about: String,
    /// The scene, in the world's frame.
    pub primitives: Vec<Primitive>,
}

impl Still {
    /// Writes it to a file, which appears whole or not at all: `/world/<path>` for each primitive, `/about` for the text.
    ///
    /// # Errors
    /// [`RecordingError::File`] where nothing can be written there.
    pub fn write(&self, file: &Path) -> Result<(), RecordingError> {
        let mut output = Output::file(file)?;
        let mut store = Store::open(StoreId::recording("lumenav", self.name.as_str()), &mut output)?;
        let always = TimePoint::default;
        let name = rerun::RecordingInfo::update_fields().with_name(self.name.as_str());
        store.log(&mut output, &EntityPath::properties(), always(), &name)?;
        store.log(&mut output, &entity("world"), always(), &rerun::ViewCoordinates::RFU())?;
        let about = rerun::TextDocument::new(self.about.as_str()).with_media_type(rerun::MediaType::MARKDOWN);
        store.log(&mut output, &entity("about"), always(), &about)?;
        let mut layout = Layout::default();
        for primitive in &self.primitives {
            extent_points_m(primitive).into_iter().for_each(|point| layout.include(point));
            let place = entity(&path(&SceneOwner::World, primitive));
            store.log_batches(&mut output, &place, always(), components(&SceneOwner::World, primitive))?;
        }
        store.flush(&mut output)?;
        blueprint::send_still(&mut output, store.id(), &layout)?;
        output.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect;

    #[test]
    fn law_a_still_holds_what_was_drawn_and_equal_ones_have_equal_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let still = Still {
            name: "map".to_owned(),
            about: "# A map".to_owned(),
            primitives: vec![
                Primitive::Points {
                    path: "map".to_owned(),
                    positions_world_m: vec![[0.0, 0.1, 0.2], [0.1, 0.1, 0.2]],
                    rgba: vec![0xff00_00ff, 0x00ff_00ff],
                    radius_m: 0.01,
                },
                Primitive::Lines {
                    path: "torso".to_owned(),
                    strips_world_m: vec![vec![[0.0; 3], [0.0, 0.0, 1.0]]],
                    rgba: vec![0x8888_88ff],
                },
            ],
        };
        let [a, b] = ["a.rrd", "b.rrd"].map(|name| folder.path().join(name));
        still.write(&a).unwrap();
        still.write(&b).unwrap();
        let summary = inspect(&a).unwrap();
        for entity in ["/world/map", "/world/torso", "/about"] {
            assert_eq!(summary.rows.get(entity), Some(&1), "{entity}: {:?}", summary.rows);
        }
        assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
        assert!(still.write(&folder.path().join("nowhere/c.rrd")).is_err());
    }
}
