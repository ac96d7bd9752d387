//! Arrays on a patient who moves: what is worn moves along, what stands in the room does not.

use super::support::*;
use lumenav_core::{FrontEnd as _, Modality as _, ModelFolder, Name, Outcome, RandomStreams, Reading};
use lumenav_magnetic::Magnetic;
use lumenav_magnetic::config::OptionsTable;
use lumenav_magnetic::front_end::MagneticFrontEnd;
use lumenav_scenario::{ScenarioFile, World, build_world};
use nalgebra::Isometry3;

/// A capsule on a line, with more behind it.
fn world(more: &str) -> Box<dyn World> {
    let text = format!(
        "[scenario]\nname = \"t\"\nduration_s = 10.0\n[capsule]\nmodel = \"pillcam-magnet\"\n[truth]\nkind = \"line\"\n\
         from_mm = [-40, 10, 30]\nto_mm = [30, -20, 10]\nspeed_mm_s = 8\n{more}"
    );
    let file = ScenarioFile::from_node(node(&text), ModelFolder::new(models())).unwrap();
    build_world(&file, 1, 0).unwrap().world
}

/// The gut rests in a patient who stands up, and walks.
const WALKING: &str = "[patient]\nbreathing_amplitude_mm = 0\norgan_shift_mm = 0\n\
    [[patient.event]]\nkind = \"posture\"\nat_s = 1.0\nto = \"upright\"\nduration_s = 2.0\n\
    [[patient.event]]\nkind = \"walk\"\nfrom_s = 4.0\nto_s = 9.0\nspeed_m_s = 0.4\n";

fn readings(world: &mut dyn World, worn: &str) -> Vec<Reading> {
    readings_in(world, worn, "")
}

fn readings_in(world: &mut dyn World, worn: &str, reality: &str) -> Vec<Reading> {
    let installed = format!("array = \"belt-16\"\nquantization = false\nsaturation = false\n{worn}");
    let mut sensor = Magnetic.sensor(&node(&installed), &node(reality), &setup([0.0; 3])).unwrap();
    let streams = RandomStreams::new(1, 0, "belt");
    (0..90)
        .map(|_| {
            let at = sensor.next_due();
            world.advance_to(at).unwrap();
            sensor.observe(world.truth(), at, &streams).unwrap().unwrap().reading
        })
        .collect()
}

/// Largest difference of any channel from `from_s` on, T.
fn largest_tesla(a: &[Reading], b: &[Reading], from_s: f64) -> f64 {
    let late = |reading: &&Reading| reading.at().seconds() >= from_s;
    let values = |reading: &Reading| reading.payload.f64("flux_tesla").unwrap().to_vec();
    let pairs = a.iter().filter(late).zip(b.iter().filter(late));
    pairs
        .flat_map(|(a, b)| values(a).into_iter().zip(values(b)))
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

#[test]
fn law_a_worn_array_reads_the_same_while_the_patient_walks_and_one_in_the_room_does_not() {
    let resting = readings(&mut *world(""), "");
    let worn = readings(&mut *world(WALKING), "worn_on = \"torso\"");
    let room = readings(&mut *world(WALKING), "");
    let (same, other) = (largest_tesla(&resting, &worn, 0.0), largest_tesla(&resting, &room, 0.0));
    println!("figure: worn {same:e} T, in the room {other:e} T");
    // Rounding of fields of 1e-6 T.
    assert!(same < 1e-18, "{same}");
    assert!(other > 1e-7, "{other}");
    // Before the patient moves all are the same.
    let early = |readings: &[Reading]| readings[..10].to_vec();
    assert_eq!(largest_tesla(&early(&resting), &early(&room), 0.0), 0.0);
}

#[test]
fn law_breath_moves_an_array_on_the_belly_and_nobody_is_told() {
    let breathing =
        "[patient]\nbreathing_amplitude_mm = 0\nbreathing_period_s = 4\nsurface_amplitude_mm = 8\n";
    let [torso, belly] =
        ["torso", "abdomen"].map(|on| readings(&mut *world(breathing), &format!("worn_on = \"{on}\"")));
    assert!(largest_tesla(&torso, &belly, 0.0) > 1e-8);
    // Between two breaths the belly is where the calibration has it.
    assert_eq!(largest_tesla(&torso[..1], &belly[..1], 0.0), 0.0);
    for reading in &belly {
        assert_eq!(reading.known_poses["array"], Isometry3::identity());
    }
    // So an estimate is off by what the belly was lifted: 8 mm at 2 s.
    let installed = installed("array = \"belt-16\"\nworn_on = \"abdomen\"\n", [0.0; 3]);
    let mut front_end =
        MagneticFrontEnd::new(Name::from("array"), &installed, &OptionsTable::from_node(&node("")).unwrap());
    let mut error_mm = |readings: &[Reading], index: usize| {
        let mut world = world(breathing);
        world.advance_to(readings[index].at()).unwrap();
        let truth = world.truth().capsule(readings[index].at()).world_from_capsule;
        let Outcome::Measured(all) = front_end.process(&readings[index], None).unwrap() else {
            panic!("refused")
        };
        let fix = all[0].fix.as_ref().unwrap().world_from_capsule;
        (fix.translation.vector - truth.translation.vector) * 1e3
    };
    let [held, lifted] = [error_mm(&torso, 20), error_mm(&belly, 20)];
    println!("figure: on the trunk {:.2} mm, on the belly {:.2} mm", held.norm(), lifted.norm());
    assert!(held.norm() < 1.0, "{held}");
    assert!((lifted.y + 8.0).abs() < 1.0 && lifted.xz().norm() < 1.5, "{lifted}");
}

#[test]
fn law_a_worn_array_tells_the_capsule_in_the_room_through_a_walk() {
    // The array's place is told with each reading: the estimate is that in the world.
    let installed = installed("array = \"belt-16\"\nworn_on = \"torso\"\n", [0.0; 3]);
    let mut front_end =
        MagneticFrontEnd::new(Name::from("array"), &installed, &OptionsTable::from_node(&node("")).unwrap());
    let mut world = world(WALKING);
    let mut farthest_m = 0.0_f64;
    for reading in readings(&mut *world, "worn_on = \"torso\"").iter().step_by(9) {
        let truth = world.truth().capsule(reading.at()).world_from_capsule;
        let Outcome::Measured(all) = front_end.process(reading, None).unwrap() else { panic!("refused") };
        let fix = all[0].fix.as_ref().unwrap().world_from_capsule;
        let error_m = (fix.translation.vector - truth.translation.vector).norm();
        assert!(error_m < 1e-3, "{} s: {error_m} m", reading.at().seconds());
        farthest_m = farthest_m.max(truth.translation.vector.norm());
    }
    assert!(farthest_m > 1.0, "{farthest_m} m");
}

#[test]
fn cross_a_patient_who_turns_sees_the_earth_turn_the_other_way() {
    // Two mechanisms: the patient turns in the room with the array on, or the world is the patient's and the field turns.
    let turning = "[patient]\nbreathing_amplitude_mm = 0\norgan_shift_mm = 0\n[[patient.event]]\nkind = \"posture\"\nat_s = 1.0\n\
                   to = \"left-lateral\"\nduration_s = 2.0\n";
    let earth = "earth_tesla = [1e-5, -4e-5, 3e-5]\n";
    let field = format!("{earth}[[turn]]\nstart_s = 1.0\nend_s = 3.0\naxis = [0, 0, 1]\nangle_deg = 90.0\n");
    let patient = readings_in(&mut *world(turning), "worn_on = \"torso\"", earth);
    let turned = readings_in(&mut *world(""), "", &field);
    let apart = largest_tesla(&patient, &turned, 3.0);
    assert!(apart < 1e-18, "{apart}");
    // The field itself is seen, and on the way the two turn at different rates.
    assert!(largest_tesla(&turned, &readings(&mut *world(""), ""), 3.0) > 1e-5);
    assert!(largest_tesla(&patient, &turned, 1.0) > 1e-7);
}
