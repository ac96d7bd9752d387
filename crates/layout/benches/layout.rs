//! How fast layouts are judged and chosen: 64 sensors at poses of a workspace, 16 of 162 candidates.

use divan::Bencher;
use lumenav_core::{CapsuleBody, ModelFolder, Name, Node, OneAfterAnother, Setup};
use lumenav_layout::optimize::Question;
use lumenav_layout::optimize::exchange::choose;
use lumenav_layout::{Criterion, Workspace, evaluate};
use lumenav_magnetic::layout::ArrayLayout;
use std::path::Path;

fn main() {
    divan::main();
}

fn node(text: &str) -> Node {
    Node::parse_text(text, "bench.toml", Path::new(""), &[]).expect("TOML")
}

fn layout(array: &str, options: &str) -> ArrayLayout {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let setup = Setup {
        sensor: Name::from("array"),
        schedule: None,
        capsule: CapsuleBody { radius_m: 5.5e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: Node::open(&models.join("capsules/pillcam-magnet.toml")).expect("a shipped model"),
        models: ModelFolder::new(models),
        map: None,
    };
    let installed = node(&format!("array = \"{array}\"\n"));
    ArrayLayout::from_nodes(&installed, &node(options), &setup).expect("a shipped array")
}

fn workspace(side: u32) -> Workspace {
    let axis =
        |name: &str, from: i32, to: i32| format!("{name} = {{ from = {from}, to = {to}, count = {side} }}\n");
    let text = axis("x_mm", -200, 200) + &axis("y_mm", -200, 200) + &axis("z_mm", 100, 400);
    Workspace::from_node(&node(&(text + "direction_count = 10\n")), |_, _| Err(node("").error("no tract")))
        .expect("a grid")
}

/// 64 sensors, 10,000 poses on one core: a tenth of what `layout evaluate` is asked to do in a second on two.
#[divan::bench(args = ["dipole", "cylinder"])]
fn evaluate_64_sensors_10000_poses(bencher: Bencher<'_, '_>, law: &str) {
    let model = layout("cube", &format!("law = \"{law}\"\n"));
    let poses = workspace(10);
    let elements = lumenav_core::LayoutModel::elements(&model);
    bencher.bench(|| evaluate(&model, elements, &poses, &OneAfterAnother, &|| false));
}

/// One start of greedy and exchange: 16 of 9 x 9 x 2 at 80 poses.
#[divan::bench]
fn choose_16_of_162(bencher: Bencher<'_, '_>) {
    let model = layout("planes-8-8", "law = \"dipole\"\ncandidates = \"planes-9x9x2\"\n");
    let question = Question::new(&model, &workspace(2), Criterion::Rms);
    bencher.bench(|| choose(&question, 16, &OneAfterAnother, &|_, _| (), &|| false));
}
