//! Imports the four surfaces of real people unaided, the colons also with the waypoints of a user, and compares each segment with the centre line given, in the surface's own frame:
//! `LUMENAV_DATA=… cargo run --release -p lumenav-anatomy --example import_people` (or with the names of some surfaces).
//!
//! Length of a segment: along the imported line between the feet of the given line's ends. Distance: mean from the given line's points to the
//! imported line; the bounds are 5 % and 3 mm.
//!
//! Finding: both small bowels meet both bounds unaided, the first person's colon with the ileocaecal valve named. Of the second
//! person's colon transverse (3.9 mm) and caecum (3.3 mm, +10 %) do not, also with nine waypoints: the given line itself runs 5 and 7 mm beside the centroids
//! of the lumen's sections there, and the outer faces, in which it is centred elsewhere, are fused between the loops.

mod people;

use lumenav_anatomy::CentreLine;
use lumenav_anatomy::import::{ImportOptions, import_surface};
use nalgebra::Point3;
use people::{Imported, PEOPLE};
use std::path::Path;
use std::time::Instant;

/// A segment's name, places and radii, m.
type Given = (String, Vec<(Point3<f64>, f64)>);

/// Places and radii of a given centre line's segments, m.
fn given(file: &Path, segments: &[&str]) -> Vec<Given> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let mut found: Vec<Given> = Vec::new();
    for line in text.lines().filter(|line| segments.contains(&line.split(',').next().unwrap_or(""))) {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |i: usize| columns[i].parse().unwrap_or(f64::NAN);
        let row = (Point3::new(number(2), number(3), number(4)), number(5));
        match found.last_mut().filter(|(name, _)| name == columns[0]) {
            Some((_, rows)) => rows.push(row),
            None => found.push((columns[0].to_owned(), vec![row])),
        }
    }
    found
}

fn main() {
    let Some(data) = std::env::var_os("LUMENAV_DATA").map(|data| Path::new(&data).join("tracts")) else {
        return println!("LUMENAV_DATA is not set");
    };
    let asked: Vec<String> = std::env::args().skip(1).collect();
    let unaided = PEOPLE.map(|one| Imported { waypoints_mm: &[], ..one });
    let guided = PEOPLE.into_iter().filter(|one| !one.waypoints_mm.is_empty());
    for Imported { person, organ, segments, waypoints_mm } in unaided.into_iter().chain(guided) {
        let surface = format!("{person}_{organ}");
        if !asked.is_empty() && !asked.iter().any(|name| surface.contains(name.as_str())) {
            continue;
        }
        let start = Instant::now();
        let waypoints_m = waypoints_mm.iter().map(|place| Point3::from(place.map(|mm| 1e-3 * mm))).collect();
        let options = ImportOptions { waypoints_m, ..ImportOptions::default() };
        let result = import_surface(&data.join(format!("{surface}.stl")), &options, &mut |_| {});
        let (count, seconds) = (waypoints_mm.len(), start.elapsed().as_secs_f64());
        println!("\n{surface}, {count} waypoints ({seconds:.1} s)");
        let tract = match result {
            Ok(tract) => tract,
            Err(error) => {
                println!("  {error}");
                continue;
            }
        };
        tract.repairs.iter().for_each(|repair| println!("  repair: {repair}"));
        tract.warnings.iter().for_each(|warning| println!("  warning: {warning}"));
        let stations: Vec<Point3<f64>> = tract.stations.iter().map(|s| s.point_m).collect();
        let Ok(line) = CentreLine::through(&stations) else { continue };
        let (mut whole_m, mut sum_mm, mut count) = (0.0, 0.0, 0);
        for (name, rows) in given(&data.join(format!("{person}_centerline.csv")), segments) {
            let feet: Vec<_> = rows.iter().map(|(p, _)| line.nearest(p, 1)[0]).collect();
            let given_m: f64 = rows.windows(2).map(|pair| (pair[1].0 - pair[0].0).norm()).sum();
            let along_m = (feet[feet.len() - 1].arc_length_m - feet[0].arc_length_m).abs();
            let away_mm = 1e3 * feet.iter().map(|foot| foot.distance_m).sum::<f64>();
            let radius_mm = |r: f64| 1e3 * r;
            let ours: f64 = feet
                .iter()
                .map(|foot| {
                    let at = foot.arc_length_m / line.length_m() * (tract.stations.len() - 1) as f64;
                    tract.stations[at.round() as usize].radius_m
                })
                .sum::<f64>()
                / feet.len() as f64;
            let theirs = rows.iter().map(|(_, r)| r).sum::<f64>() / rows.len() as f64;
            println!(
                "  {name:<15} {:7.1} mm {:+6.2} %, {:6.2} mm; radius {:.1} (given {:.1})",
                1e3 * given_m,
                100.0 * (along_m / given_m - 1.0),
                away_mm / feet.len() as f64,
                radius_mm(ours),
                radius_mm(theirs)
            );
            (whole_m, sum_mm, count) = (whole_m + given_m, sum_mm + away_mm, count + feet.len());
        }
        println!(
            "  whole: {:.1} mm given, {:.1} mm imported; {:.2} mm mean",
            1e3 * whole_m,
            1e3 * tract.length_m,
            sum_mm / f64::from(count as u32)
        );
    }
}
