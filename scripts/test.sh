#!/bin/sh
# All that CI runs: format, lints, documentation, tests, benches once. Stops at the first failure and says how long
# each step took. One profile (quick) serves all, so dependencies are built once.
set -eu
cd "$(dirname "$0")/.."
# No test may skip for want of a device or of an X server.
export GREENSTAGE_REQUIRE_GPU=1 GREENSTAGE_REQUIRE_DISPLAY=1 CARGO_TERM_COLOR=never
began=$(date +%s)
step() { # name, command…
    name=$1
    shift
    echo "── $name: $*"
    started=$(date +%s)
    if ! "$@"; then
        echo "── $name FAILED after $(($(date +%s) - started)) s" >&2
        exit 1
    fi
    times="$times
   $(printf '%6d s  %s' $(($(date +%s) - started)) "$name")"
}
times=""
step format cargo fmt --check
step crates sh scripts/crates.sh
step lints cargo clippy --profile quick --locked --all-targets -- -D warnings
RUSTDOCFLAGS="-D warnings" step documentation cargo doc --profile quick --locked --no-deps --document-private-items
step build cargo test --profile quick --locked --no-run
step tests cargo test --profile quick --locked -- --nocapture --test-threads 2
step benches cargo test --profile quick --locked --bench online
echo "── all passed in $(($(date +%s) - began)) s:$times"
