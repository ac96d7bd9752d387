//! Prints the tract file of a generated colon:
//! `cargo run -p lumenav-anatomy --example generate_colon -- SEED [LENGTH_SCALE [RADIUS_SCALE]]`.

use lumenav_anatomy::bends::Bends;
use lumenav_anatomy::generator::{ColonRequest, colon, tract_file_text};
use lumenav_core::RandomStreams;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments.get(i).map_or(Ok(1.0), |text| text.parse::<f64>());
    let seed = arguments.first().map(|text| text.parse::<u64>());
    let (Some(Ok(seed)), Ok(length_scale), Ok(radius_scale)) = (seed, number(1), number(2)) else {
        eprintln!("usage: generate_colon SEED [LENGTH_SCALE [RADIUS_SCALE]]");
        return ExitCode::from(2);
    };
    let request = ColonRequest { total_length_m: None, length_scale, radius_scale };
    match colon(&request, &RandomStreams::new(seed, 0, "colon")) {
        Ok(generated) => {
            let tract = &generated.tract;
            let bends = Bends::of(&tract.centre_line, 0.0, tract.length_m());
            for segment in &tract.segments {
                eprintln!("{:<12} {:.3} m", segment.key, segment.length_m());
            }
            eprintln!("total {:.3} m, {} attempts, {bends:?}", tract.length_m(), generated.attempts);
            let made_by =
                format!("cargo run -p lumenav-anatomy --example generate_colon -- {}", arguments.join(" "));
            print!("{}", tract_file_text(&generated.draft, &made_by));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
