//! Worlds that go on from their kept states.

use lumenav_core::config::Node;
use lumenav_core::{ModelFolder, SimTime};
use lumenav_scenario::{ScenarioFile, World, build_world};
use std::path::Path;

/// The shipped colon with a capsule in it, and more.
fn world(seed: u64, more: &str) -> Box<dyn World> {
    let text = format!(
        "[scenario]\nname = \"t\"\nduration_s = 60.0\n[capsule]\nmodel = \"pillcam-magnet\"\nstart_arc_length_mm = 100.0\n\
         [tract]\nmodel = \"colon\"\n{more}"
    );
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let node = Node::parse_text(&text, "s.toml", Path::new(""), &[]).unwrap();
    let file = ScenarioFile::from_node(node, ModelFolder::new(models)).unwrap();
    build_world(&file, seed, 0).unwrap().world
}

/// What a world tells from here on, bit by bit: truths every 50 ms, and notes.
fn goes_on(world: &mut dyn World, from_s: f64, to_s: f64) -> Vec<String> {
    let mut said = Vec::new();
    for k in 1..=((to_s - from_s) * 20.0) as i64 {
        let at = SimTime::from_seconds(from_s) + k * 50_000_000;
        world.advance_to(at).unwrap();
        let truth = world.truth().capsule(at);
        let pose = truth.world_from_capsule;
        let numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
        let numbers =
            numbers.chain(truth.velocity_world_m_s.iter()).chain(truth.specific_force_capsule_m_s2.iter());
        said.push(format!("{:x?}", numbers.map(|v| v.to_bits()).collect::<Vec<_>>()));
        said.extend(world.take_notes().into_iter().map(|note| format!("{} {}", note.at, note.text)));
    }
    said
}

const WAVES: &str = "[motility]\nspontaneous = true\ncolon = { burst_fraction = 1.0 }\n[[motility.wave]]\nstart_time_s = 2.0\n\
                     start_m = 0.02\nspeed_m_s = 0.022\nrun_m = 0.3\namplitude = 0.95\nwidth_m = 0.02\n";

#[test]
fn law_a_world_goes_on_from_its_state_bit_by_bit() {
    let patient = "[patient]\n[[patient.event]]\nkind = \"cough\"\nat_s = 4.0\n";
    let loose = "[[tract.loose]]\nkind = \"residue\"\nat_mm = 150.0\nradius_mm = 4.0\n";
    for more in [WAVES.to_owned(), format!("{patient}{WAVES}"), format!("{loose}{WAVES}")] {
        let mut whole = world(3, &more);
        whole.advance_to(SimTime::from_seconds(2.5)).unwrap();
        drop(whole.take_notes());
        let state = whole.checkpoint().expect("a state");
        let mut taken_up = world(3, &more);
        assert_eq!(taken_up.checkpoint().expect("a state").world, state.world);
        taken_up.restore(&state.bytes).unwrap();
        drop(taken_up.take_notes());
        let (expected, found) = (goes_on(&mut *whole, 2.5, 7.0), goes_on(&mut *taken_up, 2.5, 7.0));
        assert!(expected.iter().any(|said| said.contains("wave of 2.0 s")), "no wave comes by: {more}");
        assert_eq!(found, expected, "{more}");
        assert_ne!(world(4, &more).checkpoint().expect("a state").world, state.world, "another seed");
        assert!(world(4, &more).restore(&state.bytes).is_err());
        for cut in [0, 7, 8, 40, state.bytes.len() - 1] {
            let mut other = world(3, &more);
            let before = goes_on(&mut *world(3, &more), 0.0, 0.2);
            assert!(other.restore(&state.bytes[..cut]).is_err(), "{cut} bytes");
            drop(other.take_notes());
            let mut after = goes_on(&mut *other, 0.0, 0.2);
            after.retain(|said| !said.starts_with("0."));
            let before: Vec<String> = before.into_iter().filter(|said| !said.starts_with("0.")).collect();
            assert_eq!(after, before, "refused, and not as it was");
        }
    }
}

/// Contacts with what is rigid remember more than a state holds.
#[test]
fn law_a_world_with_obstacles_keeps_no_state() {
    let obstacle =
        "[[tract.obstacle]]\nkind = \"polyp\"\nsegment = \"ascending\"\nat_mm = 150.0\nradius_mm = 4.0\n";
    assert!(world(3, &format!("{obstacle}{WAVES}")).checkpoint().is_none());
}
