# `make demo` and `make test` need Python 3.11 or newer with venv, and nothing else.
VENV := .venv
ifeq ($(OS),Windows_NT)
# Programs of a virtual environment lie elsewhere there. Make is run from Git's bash: recipes are for a shell.
PYTHON ?= python
BIN := $(VENV)/Scripts
SHELL := bash
else
PYTHON ?= python3
BIN := $(VENV)/bin
endif

# Where this is set (containers do), every program and test compiles all modules anew: a third of the time that it
# takes to collect the tests.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test test-slow check golden format docs reference bench clean
.PHONY: buildings buildings-short tables tables-small fuzz-short faults-short wheel-check
# Two installations into one environment at a time would be in each other's way.
.NOTPARALLEL:
# The slowest tests are printed, the time of each is in a file.
DURATIONS := --durations=30 --junitxml=$(VENV)
# SHARD=2/3 is the second of three parts of the tests, for machines side by side.
PART := $(if $(SHARD),--splits $(word 2,$(subst /, ,$(SHARD))) --group $(word 1,$(subst /, ,$(SHARD))))

demo: $(VENV)/kernels
	$(BIN)/planfit demo -o demo

test: $(VENV)/installed-dev $(VENV)/kernels
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow" $(PART) $(DURATIONS)/tests.xml

test-slow: $(VENV)/installed-dev $(VENV)/kernels
	$(BIN)/python -m pytest -n auto --dist loadfile -m slow $(PART) $(DURATIONS)/tests-slow.xml

check: $(VENV)/installed-dev
	$(BIN)/ruff check src tests benchmarks examples docs hatch_build.py
	$(BIN)/ruff format --check src tests benchmarks examples docs hatch_build.py
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/codespell src tests docs benchmarks examples *.md

# Eight short runs beside kept poses; fails where results change. BITS=1: where a bit does, too.
golden: $(VENV)/kernels
	$(BIN)/python benchmarks/golden check $(if $(BITS),--bits)

format: $(VENV)/installed-dev
	$(BIN)/ruff check --fix src tests benchmarks examples docs hatch_build.py
	$(BIN)/ruff format src tests benchmarks examples docs hatch_build.py

# The site is in site/index.html; it needs no server and no network. --strict: a broken link is an error.
docs: $(VENV)/installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Pages that are written from the options, after a change of these.
reference: $(VENV)/installed-dev
	$(BIN)/python docs/reference.py

bench: $(VENV)/installed-bench
	$(BIN)/python benchmarks/run.py

# Every real scan and plan in the folder of PLANFIT_SHARED (../shared/data): three quarters of an hour of CPU time; goes
# on where it stopped. ONLY= words of names, LEAVE_OUT= a building, SEED= other drifts, KEEP=1 to compare with from now on.
BUILDINGS = $(BIN)/python benchmarks/buildings run -o $(VENV)/buildings.jsonl --cache $(VENV)/buildings.cache \
	$(if $(ONLY),--only "$(ONLY)") $(if $(LEAVE_OUT),--leave-out "$(LEAVE_OUT)") $(if $(SEED),--seed $(SEED)) \
	$(if $(KEEP),--keep)

buildings: $(VENV)/installed-dev $(VENV)/kernels
	$(BUILDINGS)

# A choice of it that takes a sixth of the time.
buildings-short: $(VENV)/installed-dev $(VENV)/kernels
	$(BUILDINGS) --short

# The paper's tables: about an hour on 2 cores; goes on where it stopped. REAL= folders of real scans.
tables: $(VENV)/installed
	$(BIN)/python benchmarks/paper_tables paper -o benchmarks/results/paper.json $(if $(REAL),--real $(REAL)) \
		--page docs/results.md

# The same of two small scans, in two minutes: whether they can be made, not what they say.
tables-small: $(VENV)/kernels
	rm -rf $(VENV)/tables-small
	$(BIN)/python benchmarks/paper_tables paper --small -o $(VENV)/tables-small/paper.json \
		--page $(VENV)/tables-small/results.md

# Two minutes of mutants of every reader's samples; fails where one is neither read nor refused in one line.
fuzz-short: $(VENV)/installed-dev $(VENV)/kernels
	$(BIN)/python benchmarks/fuzz --minutes 2 --seed $${FUZZ_SEED:-1}

# Faults of tracker, plan and sensor on two small scans, in two minutes; fails where planfit is wrong without a word.
faults-short: $(VENV)/installed-dev $(VENV)/kernels
	rm -f $(VENV)/faults-short.jsonl
	$(BIN)/python benchmarks/faults run --strict --scans flat "one room" --every 4 -o $(VENV)/faults-short.jsonl \
		--cache $(VENV)/faults.cache

# dist/ gets the wheels, without compiled kernels and with them; they are installed and tried outside of this folder.
wheel-check:
	rm -rf dist
	bash .ci/wheel-check $(PYTHON)

clean:
	rm -rf $(VENV) demo site dist src/planfit/compiled/ready

# A file that a virtual environment has on every system.
$(VENV)/pyvenv.cfg:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

# Compiled before the first run, as in a wheel that has them; an edited source makes numba compile at first use.
$(VENV)/kernels: $(VENV)/installed
	$(BIN)/planfit doctor --compile
	touch $@

$(VENV)/installed-dev: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/installed

$(VENV)/installed-bench: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[bench]'
	touch $@

$(VENV)/installed-docs: pyproject.toml | $(VENV)/pyvenv.cfg
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@
