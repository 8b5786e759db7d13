# Two commands: `make study` and `make test`. Both make .venv first.
PYTHON ?= python3
VENV := .venv
WORKERS ?= 2
BIN := $(VENV)/bin
# Two worker processes at most share the machine: one thread of linear algebra in each.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MPLBACKEND ?= Agg
# Compiled modules are kept even where that is off: each process would compile all libraries again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: study test trust trust-runs coverage slow lint bench docs versions reliability clean

study: $(VENV)/installed
	$(BIN)/oed run studies/ur10.yaml

# The checks take one core, and first compilations of the tests not always both: side by side.
test: $(VENV)/installed
	@$(MAKE) --no-print-directory lint & checks=$$!; \
	$(BIN)/pytest --numprocesses $(WORKERS) --dist worksteal -m "not slow"; tests=$$?; \
	wait $$checks && exit $$tests

lint: $(VENV)/installed
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/lint/docstrings.py
	$(BIN)/python tests/lint/words.py
	$(BIN)/python tests/lint/phrases.py
	$(BIN)/python tests/lint/statements.py

coverage: $(VENV)/installed
	$(BIN)/pytest --numprocesses $(WORKERS) --dist worksteal -m "not slow" --cov --cov-report=term:skip-covered

slow: $(VENV)/installed
	$(BIN)/pytest -m slow

trust: $(VENV)/installed
	$(BIN)/python tests/engines/run_trust.py --workers $(WORKERS)

trust-runs: $(VENV)/installed
	$(BIN)/python tests/engines/run_trust_runs.py --workers $(WORKERS)

bench: $(VENV)/installed
	$(BIN)/python benchmarks/linearisation.py
	$(BIN)/python benchmarks/fits.py
	$(BIN)/python benchmarks/multistart.py
	$(BIN)/python benchmarks/time_domain.py --starts 3
	$(BIN)/python benchmarks/plant.py
	$(BIN)/python benchmarks/waiting.py
	$(BIN)/python benchmarks/design.py
	$(BIN)/python benchmarks/experiments.py
	$(BIN)/python benchmarks/candidates.py
	$(BIN)/python benchmarks/cluster.py
	$(BIN)/python benchmarks/chains.py
	$(BIN)/python benchmarks/pages.py
	$(BIN)/python benchmarks/viewer.py

# Oldest and newest libraries, each Python at hand, the wheel outside the repository (half an hour).
versions: .tools/installed
	PATH="$(CURDIR)/.tools/bin:$$PATH" $(PYTHON) tests/reliability/versions.py --write

# Kills, damaged and malformed files, random designs: the figures of docs/reliability.md.
reliability: $(VENV)/installed
	$(BIN)/python tests/reliability --minutes 14 --write

docs: $(VENV)/installed
	$(BIN)/mkdocs build

clean:
	rm -rf $(VENV) .tools .bench out site

$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; set it with: make PYTHON=python3.12 ..."; exit 1; }
	@echo "Making .venv and installing (about two minutes, once) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/pip install --quiet --no-compile --editable '.[test]'
	@touch $@

.tools/installed:
	@$(PYTHON) -m venv .tools
	@.tools/bin/pip install --quiet uv
	@touch $@
