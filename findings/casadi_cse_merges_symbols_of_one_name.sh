#!/usr/bin/env bash
# CasADi 3.8.2 and 3.7.2: `cse` of an SX expression takes two different symbols that bear the same name for one, where eliminating
# a repeat makes a simplification possible. The result is another function of the same arguments; no error, no warning.
# Elsewhere in CasADi symbols are told apart by identity: Functions, Jacobians and substitutions of such expressions are right, so
# many engineers name all constants "p" or "k". What to do: give symbols names of their own before `cse`.
# States: versions, and (k + m) / (k (d / d')) with d = d' = 1 - tanh(x)^2 at k = 1, m = 2 (right: 3.0), before and after `cse`,
# with one name for k and m, and with two.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/merged.py" <<'PYTHON'
import casadi as ca

def before_and_after(first: str, second: str) -> tuple[float, float]:
    k, m, x = ca.SX.sym(first), ca.SX.sym(second), ca.SX.sym("x")
    once, again = 1 - ca.tanh(x) ** 2, 1 - ca.tanh(x) ** 2
    expression = (k + m) / (k * (once / again))
    functions = [ca.Function("f", [k, m, x], [each]) for each in (expression, ca.cse(expression))]
    return tuple(round(float(f(1, 2, 0.5)), 12) for f in functions)

print(ca.__version__, "one name", before_and_after("k", "k"), "two names", before_and_after("k", "m"))
PYTHON
for version in 3.8.2 3.7.2; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install --quiet --disable-pip-version-check "casadi==$version" "numpy==2.4.6"
  "$folder/$version/bin/python" "$folder/merged.py" | tee -a "$folder/seen"
done
diff "$folder/seen" - <<'SEEN'
3.8.2 one name (3.0, 1.5) two names (3.0, 3.0)
3.7.2 one name (3.0, 1.5) two names (3.0, 3.0)
SEEN
echo "as stated"
