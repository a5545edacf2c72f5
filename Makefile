# `make run` and `make test` are all a newcomer needs: both make .venv first, and reuse it afterwards.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
BENCH_READY := $(VENV)/.bench-ready
SCENARIO ?= scenarios/aerosonde_wind.toml
OUT ?= reports/$(basename $(notdir $(SCENARIO)))

.PHONY: run test test-slow test-min test-max bench lint lock examples clean

run: $(READY)
	$(BIN)/obsdesign run $(SCENARIO) --out $(OUT)

test: $(READY) lint
	$(BIN)/python -m pytest

test-slow: $(READY)
	$(BIN)/python -m pytest -m slow

# Tests that pass through every declared package (numpy, scipy, casadi, clarabel, cvxpy, highspy, python-flint, pydantic, matplotlib, jinja2,
# rich, shtab, pymap3d, defusedxml ...), with the oldest versions that pyproject.toml accepts, and with the newest that there are, each in
# a throw-away environment: .venv is left alone.
ACROSS_VERSIONS := rank scenario figures command_line report_page selection design_parts broken_files information

test-min test-max: test-%:
	rm -rf .venv-$* && $(PYTHON) -m venv .venv-$*
	$(PYTHON) -c 'import re, tomllib; needed = tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"]; \
	  print(*(re.sub(r">=([^,]+).*", r"==\1", each) if "$*" == "min" else each for each in needed), sep="\n")' > .venv-$*/declared.txt
	.venv-$*/bin/python -m pip install --quiet --disable-pip-version-check --requirement .venv-$*/declared.txt pytest pytest-xdist hypothesis jsonschema rosbags
	.venv-$*/bin/python -m pip install --quiet --disable-pip-version-check --no-deps .
	.venv-$*/bin/python -m pip list --disable-pip-version-check
	PYTHONPATH=$(CURDIR) TOLERATED_WARNINGS=ignore::DeprecationWarning .venv-$*/bin/python -m pytest -W ignore::DeprecationWarning $(ACROSS_VERSIONS:%=tests/test_%.py)

bench: $(BENCH_READY)
	$(BIN)/python -m benchmarks.run

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports --no-cache

# The committed examples are what a reader sees without running anything: one page, and the numbers of every scenario, without the
# records from which `obsdesign report` makes a page again: they are five times as large.
examples: $(READY)
	for scenario in scenarios/*.toml; do \
	  $(BIN)/obsdesign run $$scenario --out reports/examples/$$(basename $$scenario .toml) || exit 1; \
	done
	$(BIN)/python docs/without_records.py reports/examples/*/result.json
	$(BIN)/python docs/picture.py
	$(BIN)/obsdesign schema result > docs/result.schema.json
	$(BIN)/python docs/command_line.py

PIN = $(BIN)/pip-compile --quiet --strip-extras --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
  --no-emit-trusted-host --upgrade

# requirements-bench.lock has what the benchmarks need beyond requirements.lock, and moves nothing in there.
lock: $(READY)
	$(PIN) --extra dev --extra ardupilot --extra px4 --extra ros --extra sbml --output-file requirements.lock pyproject.toml
	$(PIN) --extra bench --constraint requirements.lock --output-file $(VENV)/bench.lock pyproject.toml
	grep -vxFf requirements.lock $(VENV)/bench.lock > requirements-bench.lock

$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "obsdesign needs Python 3.11 or newer: make PYTHON=python3.11 ...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $(READY)

$(BENCH_READY): requirements-bench.lock $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint requirements.lock --requirement requirements-bench.lock
	touch $(BENCH_READY)

clean:
	rm -rf $(VENV) .venv-min .venv-max .pytest_cache .ruff_cache
