#!/bin/sh
# Checks the licences and the known faults of every crate that the program is built from: by cargo-deny where it is
# installed and its database can be had, else the licences by deny.toml and the crates by scripts/crates.txt, the list of
# those that were looked up, with its date.
# Usage: crates.sh [update]   with `update`, writes Cargo.lock's crates into the list; change its date yourself.
set -eu
cd "$(dirname "$0")/.."
if [ "${1:-}" != update ] && command -v cargo-deny >/dev/null 2>&1 && cargo deny fetch db >/dev/null 2>&1; then
    exec cargo deny check
fi

# Licences: of each part that AND joins, one alternative must be allowed.
cargo tree --locked --edges normal,build --prefix none --format '{p}|{l}' | sed 's/ ([^|]*|/|/; s/ (\*)$//' |
    sort -u | awk -F '|' '
        BEGIN { while ((getline line < "deny.toml") > 0) if (line ~ /^    "/) { gsub(/^ *"|",?$/, "", line); allowed[line] } }
        {
            text = $2
            gsub(/ *\/ */, " OR ", text)
            parts = split(text, part, " AND ")
            for (i = 1; i <= parts; i++) {
                gsub(/[()]/, "", part[i])
                alternatives = split(part[i], alternative, " OR ")
                is_allowed = 0
                for (j = 1; j <= alternatives; j++) if (alternative[j] in allowed) is_allowed = 1
                if (!is_allowed) { print "crates: " $1 " has the licence \"" $2 "\", which deny.toml does not allow"; bad = 1 }
            }
            count++
        }
        END { print "crates: licences of " count " crates checked"; exit bad || count == 0 }'

list=scripts/crates.txt
locked=$(awk '/^name = / { name = $3 } /^version = / && name { print name, $3 }' Cargo.lock | tr -d '"' | grep -v '^greenstage ' | sort)
if [ "${1:-}" = update ]; then
    heading=$(grep '^#' $list)
    printf '%s\n%s\n' "$heading" "$locked" > $list
fi
unknown=$(printf '%s\n' "$locked" | grep -vxF -f $list || true)
if [ -n "$unknown" ]; then
    echo "crates: not looked up in the advisory database since Cargo.lock changed:" >&2
    printf '%s\n' "$unknown" | sed 's/^/    /' >&2
    echo "crates: run \`cargo deny check advisories\`, then \`sh scripts/crates.sh update\` and put the date into $list" >&2
    exit 1
fi
echo "crates: known faults: $(sed -n 's/^# //p' $list | tr '\n' ' ')"
