PY  ?= python3
BIN := .venv/bin
ROOMS := framework predictors regions robots controllers simulation experiments
WORKERS ?= 2
FIGURES ?= ellipse_construction approximation_error forecast_regions chicken_game crossing

.PHONY: help demo test lint bench fuzz mutants figures graph lock
.DEFAULT_GOAL := help

help:                   ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 12

demo: .venv/ready       ## set up, run the paper's scenarios and figures, print the tables
	$(BIN)/wideberth demo --workers 2

test: .venv/ready       ## set up and run the tests
	$(BIN)/python -m pytest -q -n auto

# mypy wants the checkout in a folder whose name is an identifier: .venv/link provides one.
lint: .venv/ready       ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	cd .venv/link && ../bin/mypy --config-file wideberth/pyproject.toml \
	  --cache-dir ../../.mypy_cache wideberth/__init__.py $(ROOMS:%=wideberth/%)
	$(BIN)/pyright

bench: .venv/ready      ## measure speed (see benchmarks/README.md)
	$(BIN)/python benchmarks/run.py

fuzz: .venv/ready       ## absurd input for planners, predictors and configs (half an hour or more)
	$(BIN)/python benchmarks/fuzz.py --workers $(WORKERS)

mutants: .venv/ready    ## change the code for the worse and count what no test sees
	$(BIN)/python -m wideberth.tests.mutation.study

figures: .venv/ready    ## draw the figures of FIGURES="name ..." (run first where need be)
	$(BIN)/wideberth figures $(FIGURES) --workers 2

graph: .venv/ready      ## draw which groups of modules import which
	$(BIN)/python docs/draw_import_graph.py

lock: .venv/ready       ## write requirements.lock anew: versions and hashes, no address
	$(BIN)/uv pip compile pyproject.toml --all-extras --universal --python-version 3.11 \
	  --generate-hashes --no-header -q -o requirements.lock

.venv/ready: pyproject.toml requirements.lock
	$(PY) -m venv .venv
	$(BIN)/python -m pip install -q uv
	$(BIN)/uv pip install --python .venv -q --require-hashes -r requirements.lock
	$(BIN)/uv pip install --python .venv -q --no-deps -e .
	mkdir -p .venv/link && ln -sfn ../.. .venv/link/wideberth
	touch $@
