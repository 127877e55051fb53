# `make demo` builds the program and starts the demo.
# `make test` runs all that CI runs.
# Both install what is missing on Debian or Ubuntu, and say what and why (scripts/setup.sh).
# `make one T=solve::pcg` runs the library's tests of that name, and compiles only what has changed since the last time.

# Mesa complains where no session has set it.
XDG_RUNTIME_DIR ?= /tmp
export XDG_RUNTIME_DIR

T ?=

.PHONY: demo test one figures man manual deb install

demo:
	@sh scripts/setup.sh
	cargo build --release --locked
	target/release/greenstage

test:
	@sh scripts/setup.sh test
	@sh scripts/test.sh

one:
	CARGO_INCREMENTAL=1 cargo test --profile quick --locked --lib -- $(T)

# Man pages and shell completions, into target/package.
man:
	cargo build --release --locked
	mkdir -p target/package/completions
	target/release/greenstage man -o target/package/man
	target/release/greenstage completions bash > target/package/completions/greenstage.bash
	target/release/greenstage completions zsh > target/package/completions/_greenstage
	target/release/greenstage completions fish > target/package/completions/greenstage.fish

# The manual as HTML with pictures, into target/manual/html; mdbook is installed into target/tools where it is missing.
manual:
	cargo build --release --locked
	@sh scripts/manual.sh

# A Debian package, into target/debian; cargo-deb is installed into target/tools where it is missing.
deb: man
	@command -v cargo-deb > /dev/null || test -x target/tools/bin/cargo-deb || cargo install cargo-deb --version 2.12.1 --locked --root target/tools
	sh scripts/notices.sh target/package/third-party.txt
	PATH="$$PWD/target/tools/bin:$$PATH" cargo deb --no-build

# The program for this user, into ~/.cargo/bin; it needs no other file.
install:
	cargo install --path . --locked

# Measures on this machine and writes the tables and the plot of the README and the tables of the manual's chapters `verify`, `cases`, `stability` and `forces`.
figures:
	@sh scripts/setup.sh
	cargo build --release --locked
	target/release/greenstage bench configs/scenes/tube.toml --readme README.md
	target/release/greenstage accuracy configs/scenes/tube.toml -o out/accuracy --readme README.md
	mkdir -p assets
	cp out/accuracy/plots/online.svg assets/accuracy.svg
	target/release/greenstage scale --up-to 1000000 -o out/scale --readme README.md
	cp out/scale/scale-time.svg assets/scale-time.svg
	target/release/greenstage demo --no-film -o out/demo
	cp out/demo/contact-sheet.png assets/demo.png
	target/release/greenstage render configs/scenes/models.toml --frames 3 --window-scale 0.5 -o out/models
	cp out/models/contact-sheet.png assets/models.png
	target/release/greenstage verify forces --readme src/manual/reference/forces.md
	target/release/greenstage verify bent --readme src/manual/reference/stability.md
	target/release/greenstage verify --readme src/manual/reference/verify.md
	target/release/greenstage verify hard-cases --readme src/manual/reference/cases.md
	target/release/greenstage verify haptics --readme src/manual/reference/stability.md
