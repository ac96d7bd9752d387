#![allow(dead_code)]
#[path = "../tests/tracking/support.rs"]
mod support;
use lumenav_pet::tracking::{
    Preparation, Window,
    centroid::{Centroid, Weight},
};
use nalgebra::Vector3;
use support::*;
fn sim() {
    use lumenav_pet::simulation::*;
    let set = triangle();
    let isotope = Isotope::from_node(&model("isotopes", "na-22")).unwrap();
    let markers: Vec<SourceMarker> = set
        .markers
        .iter()
        .map(|m| SourceMarker {
            position_capsule_m: m.position_capsule_m,
            activity_bq: m.activity_bq,
            isotope: isotope.clone(),
            core_diameter_m: 5e-4,
            shell: None,
        })
        .collect();
    for name in ["reduced", "allegro"] {
        for d in ["water-20", "water-40"] {
            let sc = scanner(name);
            let ph = lumenav_anatomy::phantom::Phantom::from_node(&model("phantoms", d)).unwrap();
            let mut sim = Simulator::new(
                sc.clone(),
                scintillator(&sc),
                Some(ph),
                markers.clone(),
                Settings { mode: Mode::Analog, ..Settings::default() },
            );
            let streams = lumenav_core::RandomStreams::new(1, 0, "s");
            let mut out = vec![];
            let mut rs = vec![];
            let mut n = 0;
            let t = std::time::Instant::now();
            for w in 0..(if name == "allegro" { 4 } else { 24 }) {
                let start = w as f64 * 1.5;
                sim.window(&|t| helix(t, 1.0), start, 0.05, &streams, w, &mut out);
                let at = helix(start + 0.025, 1.0).transform_point(&set.centroid_capsule_m().into()).coords;
                for l in &out {
                    n += 1;
                    let o = l.label.origin;
                    if !format!("{o:?}").starts_with("True") {
                        let nn = (l.line.ends_world_m[1] - l.line.ends_world_m[0]).normalize();
                        let v = at - l.line.ends_world_m[0];
                        rs.push((v - nn * nn.dot(&v)).norm() * 1e3);
                    }
                }
            }
            rs.sort_by(f64::total_cmp);
            let q = |p: f64| rs[(rs.len() as f64 * p) as usize];
            let near = |r: f64| {
                rs.iter().filter(|x| **x < r).count() as f64
                    / rs.len() as f64
                    / (std::f64::consts::PI * r * r)
            };
            println!(
                "{name} {d}: {n} lines, {} not true, quantiles {:.0?}, density within 10, 20, 30 mm {:.2e} {:.2e} {:.2e} /mm2, {:?}",
                rs.len(),
                [q(0.1), q(0.25), q(0.5), q(0.75), q(0.9)],
                near(10.0),
                near(20.0),
                near(30.0),
                t.elapsed()
            );
        }
    }
}

fn main() {
    if std::env::var_os("SIM").is_some() {
        return sim();
    }
    let (set, scanner) = (triangle(), scanner("reduced"));
    let mut g = Generator::new(scanner.clone(), Ends::physics(&scanner), set.clone(), 1);
    let (mut e, mut keep, mut per) = (0.0, 0.0, [0.0; 4]);
    let (mut bias, mut sq) = (Vector3::zeros(), Vector3::<f64>::zeros());
    let mut all = [0.0; 4];
    let mut rms = [0.0_f64; 3];
    let mut ds = vec![];
    for w in 0..200 {
        let motion = |t: f64| helix(t, 1.0);
        let (lines, from) = g.window(&motion, w as f64 * WINDOW_S, 233, 51);
        let truth = motion((w as f64 + 0.5) * WINDOW_S);
        let mut win = Window::default();
        win.load(&lines, &Preparation::about(truth.translation.vector), 3).unwrap();
        let mut c = Centroid::default();
        let at = c.find(&win, Weight::Uniform, 0.0133).unwrap() + win.origin_world_m();
        let want = truth.transform_point(&set.centroid_capsule_m().into()).coords;
        let b = truth.rotation.inverse() * (at - want) * 1e3;
        let bw = (at - want) * 1e3;
        bias += b / 200.0;
        sq += bw.component_mul(&bw) / 200.0;
        if w < 12 {
            println!(
                "{:?} kept {} {:?}",
                b.as_slice(),
                c.kept().len(),
                [0, 1, 2, 3].map(|m| c
                    .kept()
                    .iter()
                    .filter(|k| from[**k as usize].map_or(3, |m| m) == m)
                    .count())
            );
        }
        e += (at - want).norm() / 200.0;
        keep += c.kept().len() as f64 / 284.0 / 200.0;
        for k in c.kept() {
            per[from[*k as usize].map_or(3, |m| m)] += 1.0;
        }
        for f in &from {
            all[f.map_or(3, |m| m)] += 1.0;
        }
        for (l, f) in lines.iter().zip(&from) {
            if let Some(m) = f {
                let p = motion(l.t_s).transform_point(&set.markers[*m].position_capsule_m.into()).coords;
                let n = (l.ends_world_m[1] - l.ends_world_m[0]).normalize();
                let v = p - l.ends_world_m[0];
                let d: Vector3<f64> = v - n * n.dot(&v);
                rms[0] += d.norm_squared();
                rms[1] += d.z * d.z;
                rms[2] += 1.0;
                ds.push((d.z.abs(), (d.norm_squared() - d.z * d.z).max(0.0).sqrt()));
            }
        }
    }
    println!("bias {:?} rms {:?}", bias.as_slice(), sq.map(f64::sqrt).as_slice());
    println!(
        "centroid error {:.2} mm, kept {:.3}, kept by marker/background {:?}",
        e * 1e3,
        keep,
        [0, 1, 2, 3].map(|i| per[i] / all[i])
    );
    let n = ds.len();
    let mut z: Vec<f64> = ds.iter().map(|d| d.0).collect();
    z.sort_by(f64::total_cmp);
    let mut t: Vec<f64> = ds.iter().map(|d| d.1).collect();
    t.sort_by(f64::total_cmp);
    println!(
        "axial robust sd {:.2} rms {:.2} p99 {:.1}; transverse robust {:.2} rms {:.2} p99 {:.1}",
        z[n / 2] * 1e3 / 0.6745,
        (rms[1] / rms[2]).sqrt() * 1e3,
        z[n * 99 / 100] * 1e3,
        t[n / 2] * 1e3 / 0.6745,
        ((rms[0] - rms[1]) / rms[2]).sqrt() * 1e3,
        t[n * 99 / 100] * 1e3
    );
}
