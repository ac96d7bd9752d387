//! What the viewer shows before anybody has touched it.
//!
//! ```text
//! +---------------------------+------------------+
//! |                           | position error   |
//! |  3-D scene                +------------------+
//! |                           | NEES             |
//! |                           +------------------+
//! +-------------+-------------+ along the tract  |
//! |             |             +------------------+
//! |  camera     |  camera     | segment          |
//! |  (if any)   |             +------------------+
//! |             |             | events           |
//! +-------------+-------------+------------------+
//! ```
//!
//! The SDK's own blueprint types cannot set the eye, the background or the axes and draw random identifiers; the
//! messages are therefore put together here from the same components, with counted identifiers.
//!
//! World axes are RAS (x right, y anterior, z superior): the eye stands before the patient, a little to the side and above,
//! so that the patient's left is at the picture's right, as in radiology.

use crate::error::RecordingError;
use crate::output::Output;
use crate::palette::{self, GROUND};
use crate::store::{SIM_TIME, Store, entity};
use rerun::external::re_log_types::{BlueprintActivationCommand, TimeCell, TimePoint};
use rerun::external::re_sdk_types::blueprint::archetypes as arch;
use rerun::external::re_sdk_types::blueprint::components as comp;
use rerun::external::re_sdk_types::blueprint::datatypes::{TextLogColumn, TextLogColumnKind};
use rerun::external::re_sdk_types::datatypes::{Range1D, TimeRange, TimeRangeBoundary, VisibleTimeRange};
use rerun::log::LogMsg;
use rerun::{AsComponents, Color, StoreId, StoreKind};
use std::collections::{BTreeMap, BTreeSet};

/// Plots of a run up to this long share the time axis of the viewer, which shows about a minute; those of a longer one show all of it, each by
/// itself, s.
const LINKED_S: f64 = 60.0;

/// What the layout depends on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layout {
    /// Sensors with images, as entity paths below `/camera`.
    pub(crate) cameras: BTreeSet<String>,
    /// Smallest corner of what is in the world, m.
    pub(crate) low_m: Option<[f32; 3]>,
    /// Largest corner.
    pub(crate) high_m: Option<[f32; 3]>,
    /// Entities of which the whole past is shown.
    pub(crate) paths: Vec<String>,
    /// Highest value of the NEES plot.
    pub(crate) nees_top: Option<f64>,
    /// The stretch of the tract that the capsule was in, arc length, m; `None` where there is no tract.
    pub(crate) along_m: Option<[f64; 2]>,
    /// How long it is, as far as that is known, s.
    pub(crate) lasts_s: f64,
    /// Whether a controller moves a sensor.
    pub(crate) moved: bool,
    /// Whether there is a truth to compare with.
    pub(crate) has_truth: bool,
}

impl Layout {
    /// Widens the box by a point.
    pub(crate) fn include(&mut self, point_m: [f32; 3]) {
        if point_m.iter().any(|x| !x.is_finite()) {
            return;
        }
        let low = self.low_m.get_or_insert(point_m);
        let high = self.high_m.get_or_insert(point_m);
        for axis in 0..3 {
            low[axis] = low[axis].min(point_m[axis]);
            high[axis] = high[axis].max(point_m[axis]);
        }
    }

    /// Where the eye stands and where it looks, world m.
    fn eye(&self) -> Option<([f32; 3], [f32; 3])> {
        let (low, high) = (self.low_m?, self.high_m?);
        let mut centre = [0.0; 3];
        let mut square = 0.0;
        for axis in 0..3 {
            centre[axis] = 0.5 * (low[axis] + high[axis]);
            square += (high[axis] - low[axis]).powi(2);
        }
        // The viewer's field of view is 55 degrees: at 1.08 diagonals the box's sphere would touch the picture's edge, but
        // what is in the box hardly ever reaches its corners.
        let distance = 0.92 * square.sqrt().max(0.02);
        // Unit vector: before the patient (+y), towards the patient's left (-x), above (+z).
        let direction = [-0.36, 0.86, 0.36];
        let eye = [0, 1, 2].map(|axis| centre[axis] + distance * direction[axis]);
        Some((eye, centre))
    }
}

/// Writes views and containers, each with the next identifier.
struct Writer<'a> {
    store: &'a mut Store,
    output: &'a mut Output,
    next_id: u32,
}

impl Writer<'_> {
    fn uuid(&mut self) -> String {
        self.next_id += 1;
        format!("00000000-0000-4000-8000-{:012}", self.next_id)
    }

    fn log(&mut self, path: &str, what: &dyn AsComponents) -> Result<(), RecordingError> {
        let mut cells = BTreeMap::new();
        cells.insert("blueprint".into(), TimeCell::from_sequence(0));
        self.store.log(self.output, &entity(path), TimePoint::from(cells), what)
    }

    /// A view; gives its path.
    fn view(
        &mut self,
        class: &str,
        name: &str,
        origin: &str,
        query: &[&str],
        properties: &[(&str, &dyn AsComponents)],
    ) -> Result<String, RecordingError> {
        let path = format!("view/{}", self.uuid());
        self.log(
            &format!("{path}/ViewContents"),
            &arch::ViewContents::new(query.iter().map(|q| comp::QueryExpression((*q).into()))),
        )?;
        let view = arch::ViewBlueprint::new(comp::ViewClass(class.into()))
            .with_display_name(name)
            .with_space_origin(origin);
        self.log(&path, &view)?;
        for (property, what) in properties {
            self.log(&format!("{path}/{property}"), *what)?;
        }
        Ok(path)
    }

    /// A container of views or containers with their shares; gives its path.
    fn container(
        &mut self,
        kind: comp::ContainerKind,
        contents: &[(String, f32)],
    ) -> Result<(String, String), RecordingError> {
        let id = self.uuid();
        let path = format!("container/{id}");
        let paths = contents.iter().map(|(path, _)| comp::IncludedContent(path.as_str().into()));
        let mut container = arch::ContainerBlueprint::new(kind).with_contents(paths);
        let shares = contents.iter().map(|(_, share)| *share);
        if kind == comp::ContainerKind::Horizontal {
            container = container.with_col_shares(shares.map(comp::ColumnShare::from));
        } else {
            container = container.with_row_shares(shares.map(comp::RowShare::from));
        }
        self.log(&path, &container)?;
        Ok((path, id))
    }
}

/// Sends the blueprint of a recording.
///
/// `number` tells apart the blueprints of one run: a live viewer gets one at the start and a better one at the end.
pub(crate) fn send(
    output: &mut Output,
    recording: &StoreId,
    layout: &Layout,
    number: u32,
) -> Result<(), RecordingError> {
    arrange(output, recording, number, |writer| {
        let left = left_side(writer, layout)?;
        let right = right_side(writer, layout)?;
        Ok(vec![(left, 1.75), (right, 1.0)])
    })
}

/// Sends the blueprint of a still: the scene, and the text beside it.
pub(crate) fn send_still(
    output: &mut Output,
    recording: &StoreId,
    layout: &Layout,
) -> Result<(), RecordingError> {
    arrange(output, recording, 0, |writer| {
        let scene = left_side(writer, layout)?;
        let about = writer.view("TextDocument", "About", "/about", &["+ /about"], &[])?;
        Ok(vec![(scene, 2.6), (about, 1.0)])
    })
}

/// Views side by side, with their shares.
fn arrange(
    output: &mut Output,
    recording: &StoreId,
    number: u32,
    views: impl FnOnce(&mut Writer<'_>) -> Result<Vec<(String, f32)>, RecordingError>,
) -> Result<(), RecordingError> {
    let id = StoreId::new(
        StoreKind::Blueprint,
        recording.application_id().clone(),
        format!("{}-layout-{number}", recording.recording_id().as_str()),
    );
    let mut store = Store::open(id.clone(), output)?;
    let mut writer = Writer { store: &mut store, output, next_id: 0 };
    let side_by_side = views(&mut writer)?;
    let (_, root) = writer.container(comp::ContainerKind::Horizontal, &side_by_side)?;
    // Safe to parse: the identifier was formatted as a UUID just above.
    let uuid = rerun::external::re_sdk_types::external::uuid::Uuid::parse_str(&root)
        .map_err(|e| RecordingError::Encode { target: "blueprint".into(), why: e.to_string() })?;
    writer.log(
        "viewport",
        &arch::ViewportBlueprint::new()
            .with_root_container(comp::RootContainer(uuid.into()))
            .with_auto_layout(false)
            .with_auto_views(false),
    )?;
    panels(&mut writer)?;
    store.flush(output)?;
    output.send(LogMsg::BlueprintActivationCommand(BlueprintActivationCommand {
        blueprint_id: id,
        make_active: true,
        make_default: true,
    }))
}

/// Panels closed; the time panel shows simulated time, at its end, so that the whole run is in the picture.
fn panels(writer: &mut Writer<'_>) -> Result<(), RecordingError> {
    let closed = arch::PanelBlueprint::new().with_state(comp::PanelState::Collapsed);
    writer.log("blueprint_panel", &closed)?;
    writer.log("selection_panel", &closed)?;
    writer.log(
        "time_panel",
        &arch::TimePanelBlueprint::new()
            .with_state(comp::PanelState::Collapsed)
            .with_timeline(SIM_TIME)
            .with_play_state(comp::PlayState::Following),
    )
}

/// The scene, and the cameras below it.
fn left_side(writer: &mut Writer<'_>, layout: &Layout) -> Result<String, RecordingError> {
    let background =
        arch::Background::new(comp::BackgroundKind::SolidColor).with_color(Color::from_u32(GROUND));
    let grid = arch::LineGrid3D::new().with_visible(false);
    let mut eye =
        arch::EyeControls3D::new().with_kind(comp::Eye3DKind::Orbital).with_eye_up([0.0_f32, 0.0, 1.0]);
    if let Some((position, target)) = layout.eye() {
        eye = eye.with_position(position).with_look_target(target);
    }
    let name = if layout.along_m.is_some() {
        format!("Scene (world, m; {})", palette::SPEED_LEGEND)
    } else {
        "Scene (world, m)".to_owned()
    };
    let scene = writer.view(
        "3D",
        &name,
        "/world",
        &["+ /world/**"],
        &[("Background", &background), ("LineGrid3D", &grid), ("EyeControls3D", &eye)],
    )?;
    let whole_past = arch::VisibleTimeRanges::new([comp::VisibleTimeRange(VisibleTimeRange {
        timeline: SIM_TIME.into(),
        range: TimeRange {
            start: TimeRangeBoundary::Infinite,
            end: TimeRangeBoundary::CursorRelative(0.into()),
        },
    })]);
    for path in &layout.paths {
        writer.log(&format!("{scene}/ViewContents/overrides/{path}/visualizers"), &whole_past)?;
    }
    if layout.cameras.is_empty() {
        return Ok(scene);
    }
    let mut cameras = Vec::new();
    for camera in &layout.cameras {
        let origin = entity(&format!("camera/{camera}")).to_string();
        cameras.push((writer.view("2D", camera, &origin, &["+ $origin/**"], &[])?, 1.0));
    }
    let (row, _) = writer.container(comp::ContainerKind::Horizontal, &cameras)?;
    Ok(writer.container(comp::ContainerKind::Vertical, &[(scene, 2.4), (row, 1.0)])?.0)
}

/// A time axis from the first to the last row.
fn whole_run() -> arch::TimeAxis {
    let all = TimeRange { start: TimeRangeBoundary::Infinite, end: TimeRangeBoundary::Infinite };
    arch::TimeAxis::new().with_link(comp::LinkAxis::Independent).with_view_range(comp::TimeRange(all))
}

/// Plots and events.
fn right_side(writer: &mut Writer<'_>, layout: &Layout) -> Result<String, RecordingError> {
    let background = arch::PlotBackground::new().with_color(Color::from_u32(GROUND)).with_show_grid(true);
    let legend = arch::PlotLegend::new().with_corner(comp::Corner2D::LeftTop);
    let axis = if layout.lasts_s > LINKED_S {
        whole_run()
    } else {
        arch::TimeAxis::new().with_link(comp::LinkAxis::LinkToGlobal)
    };
    let mut rows = Vec::new();
    let plot = |writer: &mut Writer<'_>, name: &str, origin: &str, range: Option<[f64; 2]>| {
        let range = range.map(|range| arch::ScalarAxis::new().with_range(Range1D(range)));
        let mut properties: Vec<(&str, &dyn AsComponents)> =
            vec![("PlotBackground", &background), ("PlotLegend", &legend), ("TimeAxis", &axis)];
        if let Some(range) = &range {
            properties.push(("ScalarAxis", range));
        }
        writer.view("TimeSeries", name, origin, &["+ $origin/**"], &properties)
    };
    if layout.has_truth {
        rows.push((plot(writer, "Position error (mm)", "/plots/error", None)?, 1.0));
        rows.push((
            plot(writer, "NEES with 95 % band", "/plots/nees", layout.nees_top.map(|top| [0.0, top]))?,
            1.0,
        ));
    }
    if let Some([low_m, high_m]) = layout.along_m {
        let margin_m = (0.05 * (high_m - low_m)).max(1e-3);
        let range = Some([low_m - margin_m, high_m + margin_m]);
        rows.push((plot(writer, "Along the tract (m)", "/plots/along_tract", range)?, 0.8));
        let timeline =
            writer.view("StateTimeline", "Segment", "/segment", &["+ $origin/**"], &[("TimeAxis", &axis)])?;
        rows.push((timeline, 0.4));
    }
    if layout.moved {
        rows.push((plot(writer, "Moved sensor along z (mm)", "/plots/moved", None)?, 0.6));
    }
    let kind = |kind, visible: bool| comp::TextLogColumn(TextLogColumn { visible: visible.into(), kind });
    let columns = arch::TextLogColumns::new().with_text_log_columns([
        kind(TextLogColumnKind::LogLevel, true),
        kind(TextLogColumnKind::EntityPath, false),
        kind(TextLogColumnKind::Body, true),
    ]);
    let events =
        writer.view("TextLog", "Events", "/events", &["+ /events/**"], &[("TextLogColumns", &columns)])?;
    rows.push((events, 0.8));
    Ok(writer.container(comp::ContainerKind::Vertical, &rows)?.0)
}
