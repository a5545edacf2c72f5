#!/usr/bin/env bash
# CasADi 3.8.2 and 3.7.2: a column of two or more entries indexed by a list gives a column, but a column of ONE entry (1 x 1) indexed
# by a list of two gives a row: x[[0, 0]] is 2 x 1 for x of 3 x 1, and 1 x 2 for x of 1 x 1. The same for SX, MX and DM.
# Whoever gathers entries of a state by places (one output per place) gets a row where a model has a single state, and errors or
# broadcasts later on. What to do: give both indices, x[[0, 0], 0], or reshape.
# States: versions, and the shapes of x[[0, 0]] for x of 3 x 1 and of 1 x 1, and of x[[0, 0], 0] for x of 1 x 1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/shapes.py" <<'PYTHON'
import casadi as ca

for kind in (ca.SX, ca.MX, ca.DM):
    column, scalar = kind(3, 1), kind(1, 1)
    print(ca.__version__, kind.__name__, column[[0, 0]].shape, scalar[[0, 0]].shape, scalar[[0, 0], 0].shape)
PYTHON
for version in 3.8.2 3.7.2; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install --quiet --disable-pip-version-check "casadi==$version" "numpy==2.4.6"
  "$folder/$version/bin/python" "$folder/shapes.py" | tee -a "$folder/seen"
done
diff "$folder/seen" - <<'SEEN'
3.8.2 SX (2, 1) (1, 2) (2, 1)
3.8.2 MX (2, 1) (1, 2) (2, 1)
3.8.2 DM (2, 1) (1, 2) (2, 1)
3.7.2 SX (2, 1) (1, 2) (2, 1)
3.7.2 MX (2, 1) (1, 2) (2, 1)
3.7.2 DM (2, 1) (1, 2) (2, 1)
SEEN
echo "as stated"
