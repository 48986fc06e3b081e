# One command per intent, the same on a laptop and in CI. `make help` lists them.
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3
# The robot of the demo: solo12, go2, go1, a1, anymal_c, hyq, or a file (docs/your-robot.md).
ROBOT ?= solo12
# The folder of its run; without one, runs/demo or runs/demo-ROBOT.
RUN ?=
# One BLAS thread per process: the work is spread over processes, and bits depend on threads.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# Images of containers often keep Python from writing bytecode. Tests start hundreds of processes,
# and each of them would compile the package again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help venv demo test test-thorough test-slow test-docs test-pages test-trackio check docs linkcheck format bench peers reproduce reproduce-smoke release-check system clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

venv: $(VENV)/.complete  ## .venv with everything that demo, test, check and docs need

$(VENV)/.complete: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || \
	  { echo "surefoot needs Python 3.11 to 3.13; this is $$($(PYTHON) --version 2>&1)." \
	    "Name another one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[viz,dev,docs]'
	$(BIN)/surefoot doctor
	@touch $@

demo: venv  ## train a policy with LocoSafeDAGGER, evaluate it, film it (minutes); ROBOT=go2 for another robot
	$(BIN)/surefoot demo --robot $(ROBOT) $(if $(RUN),--run $(RUN))

test: venv  ## the tests that are run often
	$(BIN)/python -m pytest -n auto --dist worksteal

test-thorough: venv  ## further cases of what those tests show: every kill, method and number of workers
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'thorough and not slow'

test-slow: venv  ## the tests that take minutes
	$(BIN)/python -m pytest -n auto --dist worksteal -m slow

test-docs: venv  ## the programs and the cheap commands of the documentation, as they stand there
	$(BIN)/python -m pytest -n auto --dist worksteal -m documented tests/docs

test-pages: venv  ## the pages in the browser, in a headless Chromium (make system installs it)
	$(BIN)/python -m pytest -rs -m page tests

test-trackio: .venv-trackio/.complete  ## the test of the tracker trackio, which wants an older Pillow than constraints.txt
	.venv-trackio/bin/python -c 'import trackio'
	.venv-trackio/bin/python -m pytest tests/runs/test_tracking.py -k trackio

.venv-trackio/.complete: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-trackio
	.venv-trackio/bin/python -m pip install --quiet --upgrade pip
	grep -v '^pillow==' constraints.txt > .venv-trackio/constraints.txt
	.venv-trackio/bin/python -m pip install --quiet -c .venv-trackio/constraints.txt -e '.[trackio]' pytest
	@touch $@

check: venv  ## format, lint, types, import contracts, plain Python
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python checks/plain_python.py src examples benchmarks checks

docs: venv  ## the documentation site, in docs/_build; every warning is an error
	$(BIN)/python -m sphinx -W --keep-going -q -b html -c docs . docs/_build
	@echo "the site: docs/_build/index.html"

linkcheck: venv  ## whether the links of the documentation lead somewhere; to other sites, where there is a network
	$(BIN)/python -m sphinx -W --keep-going -q -b linkcheck -c docs . docs/_build/linkcheck

format: venv  ## format, and fix what ruff can fix
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: venv  ## speed of plan, engine, training, evaluation and a quick run, with lower bounds
	$(BIN)/surefoot bench

reproduce: venv  ## the paper's experiment and the study of methods, with reports (a day on two cores; goes on where it stopped)
	$(BIN)/surefoot study paper --folder studies/paper
	$(BIN)/surefoot report studies/paper
	$(BIN)/surefoot study regimes --folder studies/regimes
	$(BIN)/surefoot report studies/regimes

reproduce-smoke: venv  ## the same path in minutes: a tiny study, killed and resumed, with its report
	$(BIN)/python checks/interrupt_study.py studies/smoke

peers: .venv-peers/.complete  ## collection speed, compared with imitation and Stable-Baselines3 (three minutes)
	.venv-peers/bin/python benchmarks/peers/compare.py $(if $(JSON),--json-file $(JSON))

.venv-peers/.complete: benchmarks/peers/requirements.txt pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-peers
	.venv-peers/bin/python -m pip install --quiet --upgrade pip
	sed -nE 's/^([a-z0-9-]+==).*/^\1/p' $< | sed 's/-/[-_]/g' > .venv-peers/pinned_by_peers
	grep -v -f .venv-peers/pinned_by_peers constraints.txt > .venv-peers/constraints.txt
	.venv-peers/bin/python -m pip install --quiet -c .venv-peers/constraints.txt -e . -r $<
	@touch $@

release-check: venv  ## build wheel and sdist, install the wheel in an empty environment, use it there
	$(BIN)/python checks/release_check.py $(if $(DEMO),--demo)

system:  ## Debian packages for Pinocchio and headless rendering, and a browser for the page tests (needs root)
	apt-get update -qq && apt-get install -y -qq libgomp1 libegl1 libopengl0 libgl1-mesa-dri
	apt-get install -y -qq --no-install-recommends chromium

clean:  ## remove the environments and caches; runs stay
	rm -rf $(VENV) .venv-peers .venv-trackio docs/_build .pytest_cache .ruff_cache .hypothesis .import_linter_cache
