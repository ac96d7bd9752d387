use super::super::compton::ELECTRON_REST_ENERGY_EV;
use super::super::scintillator::tests::model;
use super::*;
use lumenav_core::{Node, RandomStreams};
use std::path::Path;

fn scanner(name: &str) -> Scanner {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners");
    Scanner::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap()
}

/// Responses to photons straight into the middle of the block, spread over one pitch.
fn responses(n: usize, energy_ev: f64) -> Vec<Option<Deposit>> {
    let allegro = scanner("allegro");
    let block = BlockPhysics::new(&allegro, model("gso"));
    let mut random = RandomStreams::new(6, 0, "block").stream("response", 0);
    (0..n)
        .map(|_| {
            let start = Vector3::new(
                4.3e-3 * (random.random::<f64>() - 0.5),
                6.3e-3 * (random.random::<f64>() - 0.5),
                -0.1,
            );
            let mut photon = Photon::emitted(start, Vector3::z(), energy_ev);
            block.respond(&mut photon, &mut random)
        })
        .collect()
}

#[test]
fn closed_form_share_of_photons_that_interact() {
    // Photons along the gaps see nothing but voids; the others 20 mm of GSO.
    let n = 60_000;
    let seen = responses(n, ELECTRON_REST_ENERGY_EV).iter().flatten().count() as f64 / n as f64;
    let total = model("gso").attenuation_per_m(ELECTRON_REST_ENERGY_EV)[0];
    let fill = 4.0 / 4.3 * 6.0 / 6.3;
    let expected = fill * (1.0 - (-total * 0.02).exp());
    assert!(
        (seen - expected).abs() < 4.0 * (expected * (1.0 - expected) / n as f64).sqrt(),
        "{seen} {expected}"
    );
}

#[test]
fn law_energy_is_conserved_and_the_winner_lies_in_its_crystal() {
    let allegro = scanner("allegro");
    let block = BlockPhysics::new(&allegro, model("gso"));
    let mut random = RandomStreams::new(7, 0, "block").stream("response", 0);
    for energy_ev in [60e3, 511e3, 1274.5e3] {
        for _ in 0..4000 {
            let place = Vector3::new(0.08 * (random.random::<f64>() - 0.5), 0.0, -0.05);
            let direction = Vector3::new(0.3, 0.2, 1.0).normalize();
            let mut photon = Photon::emitted(place, direction, energy_ev);
            let Some(deposit) = block.respond(&mut photon, &mut random) else {
                assert_eq!(photon.energy_ev, energy_ev);
                continue;
            };
            assert!((deposit.energy_ev + photon.energy_ev - energy_ev).abs() < 1e-6);
            assert!(deposit.crystal_energy_ev <= deposit.energy_ev * (1.0 + 1e-12));
            assert_eq!(block.crystal(&deposit.place_block_m), Some(deposit.crystal));
            assert!((0.0..=0.02).contains(&deposit.place_block_m.z));
        }
    }
}

#[test]
fn cross_photons_scatter_between_crystals_as_the_reference_study_says() {
    // The study's scale mixture: three quarters with spreads (root of S) of 1.4 mm tangential and 2.1 mm axial, a quarter with
    // eleven times these variances. Full-energy photons, perpendicular: a quarter or so must end up beyond the crystal they entered.
    let detection = scanner("allegro").detection;
    let mut random = RandomStreams::new(8, 0, "block").stream("window", 0);
    let accepted: Vec<Deposit> = responses(60_000, ELECTRON_REST_ENERGY_EV)
        .into_iter()
        .flatten()
        .filter(|d| passes_window(&detection, d.energy_ev, &mut random))
        .collect();
    let beside = accepted.iter().filter(|d| d.crystal != (10, 14) && d.crystal != (11, 14)).count();
    let share = beside as f64 / accepted.len() as f64;
    assert!((0.12..0.4).contains(&share), "{share} of photons are placed in another crystal");
    let far = accepted.iter().filter(|d| d.place_block_m.x.abs() > 8e-3).count() as f64;
    let far = far / accepted.len() as f64;
    assert!((0.01..0.12).contains(&far), "{far} of photons are placed more than 8 mm away");
}

#[test]
fn closed_form_the_energy_blur_and_the_kill_energy() {
    let detection = scanner("allegro").detection;
    // FWHM of 15 % of 511 keV.
    let fwhm_ev = energy_sigma_ev(&detection, ELECTRON_REST_ENERGY_EV) * FWHM_PER_SIGMA;
    assert!((fwhm_ev / ELECTRON_REST_ENERGY_EV - 0.15).abs() < 1e-12);
    let kill_ev = kill_energy_ev(&detection);
    assert!((kill_ev + 4.0 * energy_sigma_ev(&detection, kill_ev) - 434.35e3).abs() < 1e-3);
    assert!((kill_ev - 330e3).abs() < 1e3, "{kill_ev}");
    // The window is 2.355 standard deviations of a full deposit wide on each side.
    let mut random = RandomStreams::new(9, 0, "block").stream("window", 0);
    let n = 40_000;
    let passed = (0..n).filter(|_| passes_window(&detection, ELECTRON_REST_ENERGY_EV, &mut random)).count();
    assert!((passed as f64 / f64::from(n) - 0.9815).abs() < 0.004, "{passed}");
}

#[test]
fn closed_form_rays_enter_through_sides() {
    let allegro = scanner("allegro");
    let block = BlockPhysics::new(&allegro, model("gso"));
    let half = allegro.grid.half_width_m();
    let (near, far) = block.chord_m(&Vector3::new(-0.2, 0.0, 0.01), &Vector3::x()).unwrap();
    assert!((near - (0.2 - half)).abs() < 1e-12 && (far - (0.2 + half)).abs() < 1e-12);
    assert!(block.chord_m(&Vector3::new(0.2, 0.0, 0.01), &Vector3::x()).is_none());
    assert!(block.chord_m(&Vector3::new(0.0, 0.0, -0.1), &Vector3::x()).is_none());
    assert_eq!(block.chord_m(&Vector3::new(0.0, 0.0, 0.005), &Vector3::z()).unwrap().0, 0.0);
}

/// No ray of a neighbourhood that is said to miss the block hits it; and of the neighbourhoods that hit with none most are known to.
#[test]
fn law_a_neighbourhood_that_is_said_to_miss_hits_with_no_ray() {
    let block = BlockPhysics::new(&scanner("reduced"), model("gso"));
    let mut random = RandomStreams::new(8, 0, "block").stream("missed", 0);
    let (mut missed, mut hit) = (0, 0);
    for _ in 0..40_000 {
        let mut cube = |half: f64| Vector3::from_fn(|_, _| half * (2.0 * random.random::<f64>() - 1.0));
        let place = cube(0.9) - Vector3::new(0.0, 0.0, 0.9);
        // Most rays are aimed at about the block's edges.
        let direction = (cube(0.2) - place).normalize();
        let (within_m, within_rad) = (0.02 * cube(1.0).x.abs(), 0.05 * cube(1.0).x.abs());
        let is_missed = block.is_missed_from_about(&place, &direction, (within_m, within_rad));
        let mut is_hit = false;
        for _ in 0..20 {
            let start = place + cube(1.0).normalize() * within_m * cube(1.0).x.abs().cbrt();
            let turned = (direction + cube(1.0).cross(&direction).normalize() * within_rad.sin()).normalize();
            is_hit |= block.chord_m(&start, &turned).is_some();
        }
        assert!(!(is_missed && is_hit), "{place} {direction} {within_m} {within_rad}");
        missed += u32::from(is_missed);
        hit += u32::from(is_hit);
    }
    assert!(missed > 5_000 && hit > 5_000, "{missed} missed, {hit} hit");
}

/// Without a neighbourhood the answer is the ray's own: what is not said to miss, from the front, mostly hits.
#[test]
fn law_a_ray_that_is_said_to_miss_does() {
    let block = BlockPhysics::new(&scanner("reduced"), model("gso"));
    let mut random = RandomStreams::new(9, 0, "block").stream("missed", 0);
    let [mut wrong, mut open] = [0, 0];
    for _ in 0..100_000 {
        let mut cube = |half: f64| Vector3::from_fn(|_, _| half * (2.0 * random.random::<f64>() - 1.0));
        let place = cube(0.3) - Vector3::new(0.0, 0.0, 0.45);
        let direction = (cube(0.15) - place).normalize();
        let (is_missed, is_hit) =
            (block.is_missed_from_the_front(&place, &direction), block.chord_m(&place, &direction).is_some());
        assert!(!(is_missed && is_hit), "{place} {direction}");
        wrong += u32::from(!is_missed && !is_hit);
        open += u32::from(!is_missed);
    }
    assert!(f64::from(wrong) < 0.1 * f64::from(open), "{wrong} of {open}");
}
