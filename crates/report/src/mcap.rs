//! Truth and tracks as one MCAP file, as robotics tools (Foxglove, ROS bags) read them.
//!
//! ```text
//! channel /truth             foxglove.PoseInFrame as JSON, one message per written truth
//! channel /tracks/<track>    foxglove.PoseInFrame as JSON, one message per estimate
//! metadata lumenav           scenario, seed, version, … as the caller gives them
//! ```
//!
//! Log and publish time are *simulated* time, ns; an instant before 0 cannot stand in the format and is refused. The frame
//! is `world` (RAS: x right, y anterior, z superior), the pose world_from_capsule in metres, quaternion Hamilton. Messages are
//! in order of time, at equal times in the order of the channels. Chunks are not compressed: every reader can read them.
//! Equal poses give equal bytes.
//!
//! Format: <https://mcap.dev/spec>; message: <https://docs.foxglove.dev/docs/sdk/schemas/pose-in-frame>.

use crate::error::ReportError;
use crate::file::OutputFile;
use crate::tum::StampedPose;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::{NoSeek, WriteOptions};
use std::collections::BTreeMap;
use std::path::Path;

/// The message's schema, as its publisher writes it.
const POSE_IN_FRAME: &str = r#"{
  "title": "foxglove.PoseInFrame",
  "description": "A timestamped pose for an object or reference frame in 3D space",
  "type": "object",
  "properties": {
    "timestamp": {
      "type": "object",
      "title": "time",
      "properties": {
        "sec": { "type": "integer", "minimum": 0 },
        "nsec": { "type": "integer", "minimum": 0, "maximum": 999999999 }
      },
      "description": "Timestamp of pose"
    },
    "frame_id": { "type": "string", "description": "Frame of reference for pose position and orientation" },
    "pose": {
      "title": "foxglove.Pose",
      "description": "Pose in 3D space",
      "type": "object",
      "properties": {
        "position": {
          "title": "foxglove.Vector3",
          "type": "object",
          "properties": { "x": { "type": "number" }, "y": { "type": "number" }, "z": { "type": "number" } }
        },
        "orientation": {
          "title": "foxglove.Quaternion",
          "type": "object",
          "properties": {
            "x": { "type": "number" }, "y": { "type": "number" }, "z": { "type": "number" }, "w": { "type": "number" }
          }
        }
      }
    }
  }
}"#;

/// Writes channels of poses and the metadata `about`, whole or not at all.
///
/// `channels` are topics with their poses, each in order of time.
///
/// # Errors
/// [`ReportError::File`], and [`ReportError::Table`] where a pose is of a time before 0.
pub fn write_mcap(
    path: &Path,
    about: &BTreeMap<String, String>,
    channels: &[(String, Vec<StampedPose>)],
) -> Result<(), ReportError> {
    let mut file = OutputFile::beside(path)?;
    let bad = |error: mcap::McapError| {
        // Its own text of a failed write does not say why it failed.
        let cause = std::error::Error::source(&error).map_or(String::new(), |cause| format!(": {cause}"));
        ReportError::Table { path: path.to_owned(), what: format!("{error}{cause}") }
    };
    // The file is written from front to end; a writer that seeks back would need more than a buffered file.
    let options = WriteOptions::new()
        .compression(None)
        .disable_seeking(true)
        .library(format!("lumenav {}", env!("CARGO_PKG_VERSION")));
    let mut writer = options.create(NoSeek::new(Sink(&mut file))).map_err(bad)?;
    let schema = writer.add_schema("foxglove.PoseInFrame", "jsonschema", POSE_IN_FRAME.as_bytes());
    let schema = schema.map_err(bad)?;
    let mut ids = Vec::new();
    for (topic, _) in channels {
        ids.push(writer.add_channel(schema, topic, "json", &BTreeMap::new()).map_err(bad)?);
    }
    let metadata = Metadata { name: "lumenav".to_owned(), metadata: about.clone() };
    writer.write_metadata(&metadata).map_err(bad)?;
    for (channel, sequence) in in_order_of_time(channels) {
        let pose = &channels[channel].1[sequence];
        let Ok(at_ns) = u64::try_from(pose.at.0) else {
            let what =
                format!("{}: {} ns is before 0, where MCAP has no time", channels[channel].0, pose.at.0);
            return Err(ReportError::Table { path: path.to_owned(), what });
        };
        let header = MessageHeader {
            channel_id: ids[channel],
            sequence: u32::try_from(sequence).unwrap_or(u32::MAX),
            log_time: at_ns,
            publish_time: at_ns,
        };
        let text = message(pose, at_ns).to_string();
        writer.write_to_known_channel(&header, text.as_bytes()).map_err(bad)?;
    }
    writer.finish().map_err(bad)?;
    drop(writer);
    file.finish()
}

/// Channel and index of every pose.
fn in_order_of_time(channels: &[(String, Vec<StampedPose>)]) -> Vec<(usize, usize)> {
    let mut all: Vec<(usize, usize)> = channels
        .iter()
        .enumerate()
        .flat_map(|(channel, (_, poses))| (0..poses.len()).map(move |index| (channel, index)))
        .collect();
    all.sort_by_key(|&(channel, index)| (channels[channel].1[index].at, channel, index));
    all
}

fn message(pose: &StampedPose, at_ns: u64) -> serde_json::Value {
    let p = pose.world_from_capsule.translation.vector;
    let q = pose.world_from_capsule.rotation;
    serde_json::json!({
        "timestamp": { "sec": at_ns / 1_000_000_000, "nsec": at_ns % 1_000_000_000 },
        "frame_id": "world",
        "pose": {
            "position": { "x": p.x, "y": p.y, "z": p.z },
            "orientation": { "x": q.i, "y": q.j, "z": q.k, "w": q.w },
        },
    })
}

/// Lets the format's writer write into a file that appears whole or not at all.
struct Sink<'a>(&'a mut OutputFile);

impl std::io::Write for Sink<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes).map_err(std::io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::SimTime;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

    fn pose(at_ns: i64, x: f64) -> StampedPose {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), x);
        let world_from_capsule = Isometry3::from_parts(Translation3::new(x, 1.0 / 3.0, -2e-3), turn);
        StampedPose { at: SimTime(at_ns), world_from_capsule }
    }

    #[test]
    fn law_what_is_written_is_read_back_to_the_same_bits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let about = BTreeMap::from([("scenario".to_owned(), "helix".to_owned())]);
        let channels = [
            ("/truth".to_owned(), vec![pose(0, 0.1), pose(1_500_000_001, 0.2)]),
            ("/tracks/magnetic".to_owned(), vec![pose(0, 0.3), pose(7, 0.4)]),
        ];
        write_mcap(&path, &about, &channels).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let mut seen: Vec<(String, u64)> = Vec::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            assert_eq!(message.channel.schema.as_ref().unwrap().name, "foxglove.PoseInFrame");
            let (_, poses) = channels.iter().find(|(topic, _)| *topic == message.channel.topic).unwrap();
            let wanted = poses.iter().find(|p| p.at.0 as u64 == message.log_time).unwrap();
            let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            // Rust's own parser: that of `serde_json` may lose the last bit.
            let text = String::from_utf8(message.data.to_vec()).unwrap();
            let number = |pointer: &str| -> f64 {
                let keys = pointer.split('/').filter(|key| !key.is_empty());
                let rest =
                    keys.fold(text.as_str(), |rest, key| rest.split_once(&format!("\"{key}\":")).unwrap().1);
                rest.split([',', '}']).next().unwrap().parse().unwrap()
            };
            let p = wanted.world_from_capsule.translation.vector;
            let q = wanted.world_from_capsule.rotation;
            for (pointer, expected) in [("/pose/position/x", p.x), ("/pose/position/y", p.y)] {
                assert_eq!(number(pointer).to_bits(), expected.to_bits(), "{pointer}");
            }
            assert_eq!(number("/pose/orientation/w").to_bits(), q.w.to_bits());
            assert_eq!(number("/pose/orientation/y").to_bits(), q.j.to_bits());
            let ns = value.pointer("/timestamp/sec").unwrap().as_u64().unwrap() * 1_000_000_000
                + value.pointer("/timestamp/nsec").unwrap().as_u64().unwrap();
            assert_eq!(ns, message.log_time);
            seen.push((message.channel.topic.clone(), message.log_time));
        }
        let wanted =
            [("/truth", 0), ("/tracks/magnetic", 0), ("/tracks/magnetic", 7), ("/truth", 1_500_000_001)];
        assert_eq!(seen, wanted.map(|(topic, at)| (topic.to_owned(), at)));
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
        assert_eq!((metadata.name.as_str(), &metadata.metadata), ("lumenav", &about));
        // The schema is JSON itself.
        let schema: serde_json::Value = serde_json::from_str(POSE_IN_FRAME).unwrap();
        assert_eq!(schema["title"], "foxglove.PoseInFrame");
    }

    #[test]
    fn law_a_file_that_fails_does_not_appear() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let channels = [("/truth".to_owned(), vec![pose(-1, 0.1)])];
        let error = write_mcap(&path, &BTreeMap::new(), &channels).unwrap_err().to_string();
        assert!(error.contains("run.mcap: /truth: -1 ns is before 0"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
