# Everything that a checkout needs, from nothing but Python (3.11 or later) and make. `make help` lists the targets.
.DEFAULT_GOAL := help
.NOTPARALLEL:
# Some containers set it, and every process would compile again what it imports.
unexport PYTHONDONTWRITEBYTECODE
.PHONY: help run verify results train test proofs coverage mutants hostile valgrind bench format lint types contracts check docs clients wheel clean

VENV := .venv
BIN := $(VENV)/bin
PIP_ARGS ?=
# Of twenty thousand modules that are installed Python compiles those that are used, when they are.
PIP := $(BIN)/python -m pip --disable-pip-version-check install -qq --no-compile $(PIP_ARGS) -c constraints-dev.txt
INSTALL := $(PIP) --no-build-isolation --editable
# What the package needs is installed, with extras, while its kernels are compiled: with the versions that are tested.
NEEDS := $(BIN)/python .ci/needs.py
BESIDE = $(BIN)/python hatch_build.py & $(NEEDS) $(1) > $@.txt && $(PIP) -r $@.txt; status=$$?; wait $$! && exit $$status
ROOMS := sffr_gym baselines agents workbench tests docs
POLICIES := none hsc ahsc ppo sac
EVALUATE = $(BIN)/sffr evaluate $(POLICIES) --scenario $(1) --out runs/$(1) --overwrite
PYTEST_ARGS ?=
# Two workers share the processors: threads of libraries that wait, do so without turning.
PYTEST := OMP_WAIT_POLICY=passive OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile
# Tests that run in minutes with kernels as Python, and need no lanes, which only compiled ones have.
COVERED := actuators angles beam dynamics episode episode_end fleet metrics mic observation oracle overrides param_files \
	param_ranges params piezo policies printed_panel reference regulator scenario score stability statistics suite_hash \
	suppression vector_arguments
MUTANTS_ARGS ?=
HOSTILE_ARGS ?= --minutes 10
CLIENTS ?=

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile

run: $(VENV)/.run ## the case study under none, HSC, AHSC and learned policies; results in runs/, see runs/report.html
	$(call EVALUATE,excited) > $(VENV)/.excited.txt 2>&1 & $(call EVALUATE,nominal); status=$$?; \
		wait $$! || status=$$?; cat $(VENV)/.excited.txt; exit $$status # on a processor each
	$(BIN)/sffr report runs/nominal runs/excited --out runs/report.html --overwrite

verify: $(VENV)/.verify ## the simulator against SymPy, Pinocchio, MuJoCo and Exudyn; page in runs/verify
	$(BIN)/sffr verify --out runs/verify --overwrite

results: $(VENV)/.run ## the benchmark of all baselines; docs/results.md, docs/leaderboard.json and their figures
	$(BIN)/sffr benchmark --docs docs

train: $(VENV)/.dev ## PPO, SAC, TQC and CrossQ with five seeds each (two hours), their scores and figures; what is there goes on
	@for algo in ppo sac tqc crossq; do for seed in 0 1 2 3 4; do \
		out=runs/train/$$algo-$$seed; \
		$(BIN)/sffr train --algo $$algo --seed $$seed --out $$out $$(test -e $$out/train.json && echo --resume) || exit; \
	done; done
	$(BIN)/sffr curves runs/train/ppo-* runs/train/sac-* --out docs/images/learning.png --overwrite
	$(BIN)/sffr benchmark ahsc hsc-tuned runs/train/*/best.npz --out runs/train-scores
	$(BIN)/sffr benchmark ahsc hsc-tuned runs/train/*/best.npz --scenario excited --episodes 100 --out runs/train-excited
	$(BIN)/sffr seeds runs/train-scores
	$(BIN)/sffr seeds runs/train-excited

test: $(VENV)/.dev ## the tests, but the slow ones
	$(PYTEST) -m "not slow" $(PYTEST_ARGS)

proofs: $(VENV)/.dev ## the slow tests: flipped signs, other engines, killed commands, built wheels
	$(PYTEST) -m slow $(PYTEST_ARGS)

coverage: $(VENV)/.dev ## lines and branches of sffr_gym and sffr_baselines that tests run with kernels as Python
	SFFR_INTERPRETED=1 $(BIN)/python -m pytest -n 2 -m "not slow" --cov --cov-report=term $(COVERED:%=tests/test_%.py)

mutants: $(VENV)/.dev ## change the code in small ways and see whether tests notice (hours; goes on where it stopped); docs/mutants.md
	$(BIN)/python tests/mutants.py --report docs/mutants.md $(MUTANTS_ARGS)

hostile: $(VENV)/.dev ## attack files, states and robots at random, and kill commands; HOSTILE_ARGS="--minutes 60 configs policies"
	$(BIN)/python tests/hostile/campaign.py $(HOSTILE_ARGS)

valgrind: $(VENV)/.dev ## the compiled code under valgrind, for a level of x86-64 that it knows (three minutes)
	$(BIN)/python tests/valgrind.py

bench: $(VENV)/.dev ## the speed, beside MuJoCo, SciPy and Gymnasium (half an hour), and that of the single kernels
	$(BIN)/sffr bench --out runs/bench --overwrite
	$(BIN)/python -m pytest tests/benchmarks -W default --benchmark-autosave --benchmark-compare --benchmark-columns=median,iqr,rounds

format: $(VENV)/.dev ## rewrite the code in the one format
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

lint: $(VENV)/.dev ## formatting and lint rules, without changing anything
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.dev ## static types
	$(BIN)/mypy

contracts: $(VENV)/.dev ## which package may import which
	$(BIN)/lint-imports

check: lint types contracts test ## lint, types, contracts and test, without proofs

docs: $(VENV)/.dev ## the documentation, its notebooks run, into docs/_build/html; a warning is an error
	$(BIN)/python -m sphinx --builder html --fresh-env --fail-on-warning --quiet docs docs/_build/html

clients: $(VENV)/.dev ## run the programs of docs/clients in environments of their own; docs/clients/tried.md; CLIENTS="skrl zoo" for some
	$(BIN)/python tests/clients/run.py $(CLIENTS)

wheel: $(VENV)/.dev ## a wheel with compiled code for all levels of x86-64, into dist/
	SFFR_LEVELS="x86-64-v2 x86-64-v3 x86-64-v4" $(BIN)/python -m build --wheel --no-isolation

clean: ## remove the virtual environment, tool caches and build products, but no results
	rm -rf $(VENV) build dist docs/_build docs/api .coverage sffr_gym/compile/binaries
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .benchmarks .hypothesis
	find $(ROOMS) -name __pycache__ -prune -exec rm -rf {} +

# What is installed is installed again when the list of dependencies or of their versions changes, and only then.
$(VENV)/.needs: pyproject.toml constraints.txt constraints-dev.txt | $(BIN)/pip
	@echo "Installing what the package is built with into $(VENV) ..."
	@$(NEEDS) > $@.txt
	@$(PIP) -r $@.txt
	@touch $@

$(VENV)/.run: pyproject.toml constraints.txt constraints-dev.txt | $(VENV)/.needs
	@echo "Installing the package into $(VENV), and compiling its kernels ..."
	@$(call BESIDE,plot report)
	@$(INSTALL) ".[plot,report]"
	@touch $@

$(VENV)/.verify: pyproject.toml constraints.txt constraints-dev.txt | $(VENV)/.needs
	@echo "Installing the package and the engines that it is checked against into $(VENV) ..."
	@$(call BESIDE,verify)
	@$(INSTALL) ".[verify]"
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt constraints-dev.txt | $(VENV)/.needs
	@echo "Installing the package with all that its tests need into $(VENV) (a few minutes the first time) ..."
	@$(call BESIDE,dev)
	@$(INSTALL) ".[dev]"
	@touch $@ $(VENV)/.run $(VENV)/.verify

$(BIN)/pip:
	@for python in python3.11 python3; do \
		if "$$python" -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
			exec "$$python" -m venv $(VENV); \
		fi; \
	done; \
	echo "Python 3.11 or later with its venv module is needed, as python3.11 or python3 on the PATH." >&2; exit 1
