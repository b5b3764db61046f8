# PersONAL Workbench. `make demo` and `make test` set everything up on a machine with Python 3.11 to 3.14, venv and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PORT ?= 8080
# More than the cores of a small machine: tests with a served study wait as long as they compute.
WORKERS ?= 4
# Browsers draw on the processor: where they are more than the cores, pages stand still for seconds.
BROWSERS ?= 2
# Where pip looks for torch; name PyTorch's index of CPU builds here to save space on Linux without a GPU.
TORCH_INDEX ?=
export PORT TORCH_INDEX
# Where it is set, every start of Python would compile all packages again: pip leaves that to the first start.
unexport PYTHONDONTWRITEBYTECODE

# A worker that ended is not replaced: xdist may give the new one nothing to do and wait for it for ever.
PYTEST = $(BIN)/python -m pytest --dist loadfile --max-worker-restart 0 -n $(WORKERS)
QUICK = not release and not bench and not gpu
# The files of a marker: to read all of them takes each process of pytest a quarter of a minute.
MARKED = grep --recursive --files-with-matches --include='test_*.py' --extended-regexp

.PHONY: demo install test release check lint fast bench screenshots gallery figures docs locked tag clean

demo: $(VENV)/.demo
	@exec $(BIN)/personal-viz demo

# The program without the tests' packages: docs/deploy/.
install: $(VENV)/.demo

test: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --tests
	$(PYTEST) -m "$(QUICK) and not browser"
	$(PYTEST) -n $(BROWSERS) -m "$(QUICK) and browser" $$($(MARKED) 'mark\.browser' tests)

# Minutes of simulations and golden sets; pytest's exit code 5 says that no test has the mark.
release: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --tests
	@$(PYTEST) -m release $$($(MARKED) 'mark\.release' tests) || test $$? = 5

check: $(VENV)/.dev
	@$(MAKE) --jobs=2 --output-sync --no-print-directory lint fast

lint:
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/pyright

fast:
	$(PYTEST) -m "$(QUICK) and not slow and not browser"

bench: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --tests
	$(BIN)/personal-viz bench sim
	$(BIN)/personal-viz bench recordings
	$(BIN)/personal-viz bench grounding
	$(BIN)/personal-viz bench agents
	$(BIN)/personal-viz bench robot
	$(BIN)/personal-viz bench scale
	$(BIN)/personal-viz bench study --parts store load browser pogview
	$(BIN)/python -m pytest -m bench

screenshots: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --tests
	$(BIN)/python -m personal_viz.screenshots.make

# A folder for any static host: recordings in Rerun's web viewer, contact sheets, and a study's report by bots.
gallery: $(VENV)/.test
	@$(BIN)/python -m personal_viz.screenshots.gallery build/gallery

# The tables of docs/figures.md, from what `personal-viz bench WHAT --json docs/figures/WHAT.json` wrote.
figures: $(VENV)/.test
	@$(BIN)/python -m personal_viz.bench.page docs/figures docs/figures.md

docs: $(VENV)/.test
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet && echo "Written to build/docs/index.html"

# The exact files that the tests ran with: every digest is checked, nothing else is looked for. .ci/lock makes the locks.
locked: $(VENV)/.locked

$(VENV)/.locked: pyproject.toml constraints.txt requirements.lock requirements-torch.lock requirements-cuda.lock
	@$(PYTHON) .ci/check_machine.py --tests
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python .ci/install.py --locked
	@touch $(VENV)/.demo $(VENV)/.test $@

$(VENV)/.demo: pyproject.toml constraints.txt
	@$(PYTHON) .ci/check_machine.py
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python .ci/install.py
	@touch $@

# What installs the tests also collects them, and a few load Open3D.
$(VENV)/.test: $(VENV)/.demo
	@$(PYTHON) .ci/check_machine.py --tests
	@$(BIN)/python .ci/install.py test
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	@$(BIN)/python .ci/install.py dev
	@touch $@

# A release: CONTRIBUTING.md says when.
tag: $(VENV)/.test
	@.ci/tag

clean:
	rm -rf $(VENV) build dist *.egg-info
