# `make demo` and `make test` need Python 3.11 or newer with venv, and nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test check format docs reference bench tables tables-small clean

demo: $(VENV)/installed
	$(BIN)/planfit demo -o demo

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest

check: $(VENV)/installed-dev
	$(BIN)/ruff check src tests benchmarks examples docs
	$(BIN)/ruff format --check src tests benchmarks examples docs
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/codespell src tests docs benchmarks examples README.md CHANGELOG.md

format: $(VENV)/installed-dev
	$(BIN)/ruff check --fix src tests benchmarks examples docs
	$(BIN)/ruff format src tests benchmarks examples docs

# The site is in site/index.html; it needs no server and no network. --strict: a broken link is an error.
docs: $(VENV)/installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Pages that are written from the options, after a change of these.
reference: $(VENV)/installed-dev
	$(BIN)/python docs/reference.py

bench: $(VENV)/installed-bench
	$(BIN)/python benchmarks/run.py

# The paper's tables: about an hour on 2 cores; goes on where it stopped. REAL= folders of real scans.
tables: $(VENV)/installed
	$(BIN)/python benchmarks/paper_tables paper -o benchmarks/results/paper.json $(if $(REAL),--real $(REAL)) \
		--page docs/results.md

# The same of two small scans, in two minutes: whether they can be made, not what they say.
tables-small: $(VENV)/installed
	rm -rf $(VENV)/tables-small
	$(BIN)/python benchmarks/paper_tables paper --small -o $(VENV)/tables-small/paper.json \
		--page $(VENV)/tables-small/results.md

clean:
	rm -rf $(VENV) demo site

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/installed

$(VENV)/installed-bench: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[bench]'
	touch $@

$(VENV)/installed-docs: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@
