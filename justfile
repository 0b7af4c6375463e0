# Recipes for people who develop Abbe; `just` lists them. `just ci` is exactly what continuous integration runs.

_default:
    @just --list --unsorted

# The main job: identify a recorded machine, correct it live, report (out/demo/report.html)
demo *options:
    cargo run --release -- demo {{ options }}

# All tests, documentation examples included
test:
    cargo test --workspace

# The statistical tests with all their seeds (some ten minutes); in the tests above a fifth of them are tried
seeds:
    ABBE_SEEDS=all cargo test -p abbe-diagnose --test all

# Training on a graphics card, or on Mesa's software card (Debian: mesa-vulkan-drivers); compiles some 200 more crates
graphics:
    cargo test -p abbe-residual-training --features wgpu --test graphics_card

# Faults that last for minutes (some fifteen), on a quiet machine: figures for nodes/runtime/README.md
faults:
    ABBE_FAULTS=long cargo test -p abbe --test faults -- --nocapture process_may_be_stopped packets_that_exhaust storm_of_ends

# Positions of rclpy through the graph and back at 1 kHz, beside an echo of rclpy, on a quiet machine (needs ABBE_ROS_PYTHON)
round-trip:
    ABBE_ROUND_TRIPS="${ABBE_ROUND_TRIPS:-20000}" cargo test -p abbe --test live -- --nocapture positions_at_1_khz

# Scale sample to corrected sample beside bare iceoryx2, with and without realtime, then 10 kHz with counts of losses (as root, or with the limits of docs/src/reference/live.md)
real-time *options:
    cargo bench -p abbe --bench real_time -- {{ options }}

# LinuxCNC without a machine or a screen, read by the driver (Debian: linuxcnc-uspace); skipped aloud without it
linuxcnc:
    cargo test -p abbe-graph --test all -- --nocapture linuxcnc::

# DDS Security beside Fast DDS (Debian: libssl-dev, libfastrtps-dev); 29 more crates, skipped aloud without Fast DDS
secured:
    ABBE_FAST_DDS="${ABBE_FAST_DDS:-/usr}" cargo test -p abbe --features dds-security --test system -- --nocapture secured::

# The transport over Zenoh, and beside eclipse-zenoh where ABBE_ZENOH_PYTHON names a Python with it and rosbags; 108 more crates
zenoh:
    cargo test -p abbe-runtime --features zenoh --test conformance zenoh
    cargo test -p abbe --features zenoh --test system -- --nocapture zenoh::

# What computes, built for Windows; its tests in Wine (rustup target add x86_64-pc-windows-gnu; Debian: gcc-mingw-w64-x86-64, wine)
windows *options:
    cargo build --target x86_64-pc-windows-gnu -p abbe
    CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUNNER=wine cargo test --target x86_64-pc-windows-gnu -p abbe-geometry -p abbe-measurement -p abbe-conformity {{ options }}

# External links of the documents; wants a network
links:
    packaging/links

# Everything that must pass before a change is taken
ci:
    .ci/run

# Format all crates
fmt:
    cargo fmt --all

# Lints as in continuous integration
lint:
    cargo clippy --workspace --all-targets -- --deny warnings

# Documentation of all crates, private items included
doc:
    RUSTDOCFLAGS='--deny warnings' cargo doc --workspace --no-deps --document-private-items

# The book as pages in out/book (needs mdbook)
book:
    mdbook build docs

# Measure everything (optimised; keep the machine quiet)
bench *options:
    cargo bench --workspace --bench '*' {{ options }}

# Licences, bans and advisories of all dependencies (needs cargo-deny)
deny:
    cargo deny check

# Fuzz one target for a while (needs cargo-fuzz and a nightly toolchain): just fuzz msgs bag 60
fuzz crate target seconds="60":
    cd {{ crate }} && cargo +nightly fuzz run {{ target }} -- -max_total_time={{ seconds }}
