#!/bin/sh
# Writes the licences of all crates that are in the program, with their texts, for the Debian package.
# Usage: notices.sh FILE
set -eu
cd "$(dirname "$0")/.."
seen=$(mktemp -d)
trap 'rm -rf "$seen"' EXIT
sources="${CARGO_HOME:-$HOME/.cargo}/registry/src"
{
    echo "greenstage contains these crates, each under the licence that stands beside its name."
    cargo tree --locked --edges normal --prefix none --format '{p}|{l}' | sed 's/ ([^|]*|/|/; s/ (\*)$//' | sort -u |
        grep -v '^greenstage ' | while IFS='|' read -r crate licence; do
        name=${crate% v*}
        version=${crate##* v}
        printf '\n%s\n%s %s: %s\n' "────────────────────────" "$name" "$version" "$licence"
        found=""
        for text in "$sources"/*/"$name-$version"/LICEN[CS]E* "$sources"/*/"$name-$version"/COPYING* \
            "$sources"/*/"$name-$version"/NOTICE*; do
            [ -f "$text" ] || continue
            found=yes
            sum=$(cksum "$text" | cut -d ' ' -f 1)
            if [ -f "$seen/$sum" ]; then
                printf '\n(%s: the same text as that of %s)\n' "$(basename "$text")" "$(cat "$seen/$sum")"
                continue
            fi
            echo "$name $version" >"$seen/$sum"
            printf '\n'
            cat "$text"
        done
        [ -n "$found" ] || echo "(The crate has no licence file; LICENSE-MIT and LICENSE-APACHE beside this file have the usual texts.)"
    done
} > "$1"
echo "notices: $(grep -c '^────' "$1") crates in $1"
