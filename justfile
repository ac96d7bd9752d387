# Conveniences. Neither the README's commands nor CI need `just`.

# A run and its recording, in under a minute after the build.
demo:
    cargo run --release -- run scenarios/helix-magnetic.toml --force

# Quick: format, lints, the light crates. (Architecture and journeys are in `just test`.)
check:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --quiet -- -D warnings
    cargo test -p lumenav-core -p lumenav-fields -p lumenav-fusion -p lumenav-evaluation

test:
    cargo test --workspace

# Full-size acceptance; writes docs/validation/<issue>.json. On a machine that does nothing else.
validate issue="foundation":
    cargo build --release
    cargo run --release --example validate -- {{issue}}

# Benches, each beside its crate; then the peers in the same run, where Python has them (each script names its packages).
bench:
    cargo bench --workspace --bench fields
    cargo bench --workspace --bench eskf
    cargo bench --workspace --bench solve
    cargo bench --workspace --bench engine
    cargo bench --workspace --bench simulate
    cargo bench --workspace --bench track
    cargo bench --workspace --bench reader
    -for script in tests/cross/*_bench.py; do python3 "$script"; done

# Makes the expected values of other programs anew (Python 3.11; each script names its pinned packages).
cross:
    for script in tests/cross/*_reference.py tests/cross/*_filterpy.py tests/cross/*_gtsam.py \
        tests/cross/gyro_gravity.py tests/cross/lines_mixture.py \
        crates/evaluation/tests/cross/*_reference.py crates/anatomy/tests/cross/splines.py; do python3 "$script"; done
    cargo build --release
    python3 tests/cross/read_results.py

# The recordings that the repository ships.
recordings:
    cargo run --release -- run scenarios/helix-magnetic.toml --set scenario.duration_s=10 --out out/recording --force
    cp out/recording/recording.rrd viewer-recordings/helix-magnetic.rrd

doc:
    cargo doc --workspace --no-deps --open
