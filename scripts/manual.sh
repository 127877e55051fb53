#!/bin/sh
# The manual as HTML: the chapters of src/manual, with pictures that the program draws now, by mdbook.
set -e
book=target/manual
program=target/release/greenstage
PATH="$PWD/target/tools/bin:$PATH"
if ! command -v mdbook > /dev/null; then
    echo "mdbook is missing: installed into target/tools, which takes some minutes"
    cargo install mdbook --version 0.4.52 --locked --root target/tools
fi

rm -rf "$book"
mkdir -p "$book/src/pictures"
cat > "$book/book.toml" <<'TOML'
[book]
title = "greenstage"
language = "en"
src = "src"
[build]
build-dir = "html"
[output.html]
default-theme = "light"
no-section-label = true
TOML

# Pictures: NAME COMMAND…; each command writes its pictures into $out.
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
$program demo -o "$out/demo" --no-film
cp "$out/demo/contact-sheet.png" "$book/src/pictures/demo.png"
$program stage-view workbench -o "$book/src/pictures/room.png"
$program pattern workbench --output "$out/pattern"
cp "$(ls "$out"/pattern/*.png | head -n 1)" "$book/src/pictures/pattern.png"
# Bent and held: before that all numbers are 0.
$program render hose --stage demo --overlay --frames 24 -o "$out/overlay"
cp "$out"/overlay/frame0018-*.png "$book/src/pictures/overlay.png"
cp assets/models.png assets/accuracy.svg "$book/src/pictures/"

# picture CHAPTER FILE TEXT: stands below the chapter's title.
picture() {
    sed -i "1a\\
\\
![$3](pictures/$2)" "$book/src/$1.md"
}
# part TITLE FOLDER: the chapters of one part, in the order of src/manual/mod.rs.
part() {
    printf '# %s\n\n' "$1" >> "$book/src/SUMMARY.md"
    for chapter in $(sed -n "\# in \"$2\", #,/^}/s/^    \([a-z]*\): \".*\",\$/\1/p" src/manual/mod.rs); do
        cp "src/manual/$2$chapter.md" "$book/src/"
        title=$(sed -n '1s/^# //p' "src/manual/$2$chapter.md")
        printf -- '- [%s](%s.md)\n' "$title" "$chapter" >> "$book/src/SUMMARY.md"
    done
    printf '\n' >> "$book/src/SUMMARY.md"
}
printf '# greenstage\n\n' > "$book/src/SUMMARY.md"
part Guide ""
part Reference reference/
picture start demo.png "The chapters of the demo"
picture stages room.png "The two-sided workbench from outside"
picture install pattern.png "The test pattern of a screen"
picture view overlay.png "The overlay (F1)"
picture models models.png "Five rods at rest, bent and twisted"
picture accuracy accuracy.svg "Time of one evaluation against the total error"

mdbook build "$book"
echo "$book/html/index.html"
