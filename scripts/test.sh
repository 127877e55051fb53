#!/bin/sh
# All that CI runs: format, lints, documentation, tests, benches once. Stops at the first failure and says how long
# each step took. One profile (release) serves all, so dependencies are built once.
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
step lints cargo clippy --release --locked --all-targets -- -D warnings
RUSTDOCFLAGS="-D warnings" step documentation cargo doc --release --locked --no-deps --document-private-items
# The dependencies are those of the program; our own code is compiled in half the time, and checked all the same.
quick="--config profile.release.package.greenstage.opt-level=1"
step build cargo $quick test --release --locked --no-run
step tests cargo $quick test --release --locked -- --nocapture --test-threads 2
step benches cargo $quick test --release --locked --bench online
echo "── all passed in $(($(date +%s) - began)) s:$times"
