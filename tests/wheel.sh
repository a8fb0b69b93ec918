#!/bin/sh
# Build the source archive and from it the wheel, install that into a clean environment outside the
# checkout, and run a suite there.
set -eu
here=$(pwd)
room=$(mktemp -d)
trap 'rm -rf "$room"' EXIT
# A copy, because a build leaves folders behind and must not see those of an earlier one.
git archive HEAD | (mkdir "$room/source" && tar -x -C "$room/source")
"$PYTHON" -m venv "$room/builder"
"$room/builder/bin/python" -m pip install --quiet --disable-pip-version-check build
"$room/builder/bin/python" -m build --outdir "$room/dist" "$room/source" > "$room/said" 2>&1 || { cat "$room/said"; exit 1; }
# The wheel is made from the archive, which must hold the checkout but for the tests and what serves its forge.
git archive HEAD | tar -t | grep -v -e '/$' -e '^tests/' -e '^\.' | sort > "$room/wanted"
tar -tzf "$room"/dist/malus-*.tar.gz | sed 's,^[^/]*/,,' | sort > "$room/archived"
missing=$(comm -23 "$room/wanted" "$room/archived")
[ -z "$missing" ] || { echo "the source archive lacks: $missing; MANIFEST.in says what it holds"; exit 1; }
"$PYTHON" -m venv "$room/env"
names=$(cd "$room" && "$PYTHON" -m zipfile -l dist/malus-*.whl | awk 'NR > 1 { split($1, p, "/"); print p[1] }' | sort -u | grep -v dist-info)
[ "$names" = malus ] || { echo "the wheel's top-level names: expected malus, found: $names"; exit 1; }
"$room/env/bin/python" -m pip install --quiet --disable-pip-version-check -c "$here/constraints.txt" "$room"/dist/malus-*.whl
cd "$room"
env/bin/malus run quick --out "$room/quick"
test -s "$room/quick/results.parquet" && test -s "$room/quick/figure5.svg" && test -s "$room/quick/summary.md"
# The learned method: one line says what to install, and then it runs on the weights in the wheel.
env/bin/python -c "import PIL.Image; PIL.Image.linear_gradient('L').convert('RGB').save('photo.png')"
weights="$room/source/reconstruct/learned/weights/net.onnx"
[ -s "$weights" ] || { echo "expected trained weights at reconstruct/learned/weights/net.onnx, found none"; exit 1; }
if env/bin/malus filter photo.png --out "$room/filtered" 2> said; then
    echo "without onnxruntime filter worked on a picture alone"; exit 1
fi
grep -q "pip install 'malus\[net\]'" said || { echo "expected what to install, found: $(cat said)"; exit 1; }
env/bin/python -m pip install --quiet --disable-pip-version-check -c "$here/constraints.txt" "$(echo "$room"/dist/malus-*.whl)[net]"
env/bin/malus filter photo.png --out "$room/filtered"
test -s "$room/filtered/photo_uncertainty.png"
echo "the wheel runs outside the checkout"
