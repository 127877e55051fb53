# `make demo` builds the program, precomputes the demo's tube and shows it being bent.
# `make test` runs all that CI runs.
# Both install what is missing on Debian or Ubuntu, and say what and why (scripts/setup.sh).

# Mesa complains where no session has set it.
XDG_RUNTIME_DIR ?= /tmp
export XDG_RUNTIME_DIR

.PHONY: demo test figures

demo:
	@sh scripts/setup.sh
	cargo build --release --locked
	target/release/greenstage

test:
	@sh scripts/setup.sh test
	@sh scripts/test.sh

# Measures on this machine and writes the tables and the plot of the README and the tables of the manual's chapters `verify`, `check`, `haptics` and `method`.
figures:
	@sh scripts/setup.sh
	cargo build --release --locked
	target/release/greenstage bench configs/scenes/tube.toml --readme README.md
	target/release/greenstage accuracy configs/scenes/tube.toml -o out/accuracy --readme README.md
	mkdir -p assets
	cp out/accuracy/plots/online.svg assets/accuracy.svg
	target/release/greenstage render configs/scenes/tube.toml --stage workbench --frames 5 --scale 0.18 -o out/sheet
	cp out/sheet/contact-sheet.png assets/demo.png
	target/release/greenstage render configs/scenes/models.toml --frames 3 --scale 0.5 -o out/models
	cp out/models/contact-sheet.png assets/models.png
	target/release/greenstage verify forces --readme src/manual/method.md
	target/release/greenstage verify bent --readme src/manual/haptics.md
	target/release/greenstage verify --readme src/manual/verify.md
	target/release/greenstage verify hard-cases --readme src/manual/check.md
	target/release/greenstage verify haptics --readme src/manual/haptics.md
