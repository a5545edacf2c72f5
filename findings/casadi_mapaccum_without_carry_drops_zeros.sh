#!/usr/bin/env bash
# CasADi 3.8.2: a dense result of a function that is 0 for every row becomes a result without a single nonzero when the function
# is repeated by `mapaccum` and its accumulated state is empty (0 entries), from 2 repetitions on; `map` of the same function keeps
# all entries, and so does `mapaccum` with a state of 1 entry, and CasADi 3.7.2 in all cases.
# Whoever allocates a result by the function's own shape times N and evaluates through `Function.buffer()` reads memory that was
# never written. What to do: take `sparsity_out` from the repeated function, or densify its results.
# States: versions, and nonzeros of the result (3 x 1, repeated 4 times) for an empty state and for a state of one entry.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/count.py" <<'PYTHON'
import casadi as ca

def nonzeros(state: int) -> tuple[int, int]:
    x, row = ca.SX.sym("x", state), ca.SX.sym("row")
    one = ca.Function("one", [x, row], [ca.densify(x), ca.densify(ca.SX.zeros(3))])
    return one.mapaccum(4).sparsity_out(1).nnz(), one.map(4).sparsity_out(1).nnz()

print(ca.__version__, "empty state", nonzeros(0), "one entry", nonzeros(1))
PYTHON
for version in 3.8.2 3.7.2; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install --quiet --disable-pip-version-check "casadi==$version" "numpy==2.4.6"
  "$folder/$version/bin/python" "$folder/count.py" | tee -a "$folder/seen"
done
diff "$folder/seen" - <<'SEEN'
3.8.2 empty state (0, 12) one entry (12, 12)
3.7.2 empty state (12, 12) one entry (12, 12)
SEEN
echo "as stated"
