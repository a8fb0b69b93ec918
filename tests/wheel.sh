#!/bin/sh
# Build the wheel, install it into a clean environment outside the checkout, and run a suite there.
set -eu
here=$(pwd)
room=$(mktemp -d)
trap 'rm -rf "$room"' EXIT
# A copy, because a build leaves folders behind and must not see those of an earlier one.
git archive HEAD | (mkdir "$room/source" && tar -x -C "$room/source")
"$PYTHON" -m venv "$room/env"
"$room/env/bin/python" -m pip wheel --quiet --disable-pip-version-check --no-deps -w "$room/dist" "$room/source"
names=$(cd "$room" && "$PYTHON" -m zipfile -l dist/malus-*.whl | awk 'NR > 1 { split($1, p, "/"); print p[1] }' | sort -u | grep -v dist-info)
[ "$names" = malus ] || { echo "the wheel's top-level names: expected malus, found: $names"; exit 1; }
"$room/env/bin/python" -m pip install --quiet --disable-pip-version-check -c "$here/constraints.txt" "$room"/dist/malus-*.whl
cd "$room"
env/bin/malus run quick --out "$room/quick"
test -s "$room/quick/results.parquet" && test -s "$room/quick/figure5.svg" && test -s "$room/quick/summary.md"
echo "the wheel runs outside the checkout"
