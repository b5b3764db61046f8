# PersONAL Workbench. `make demo` and `make test` set everything up on a machine with Python >= 3.11, venv and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PORT ?= 8080
WORKERS ?= 2
# Where pip looks for torch; name PyTorch's index of CPU builds here to save space on Linux without a GPU.
TORCH_INDEX ?=
export PORT

PYTEST = $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile

.PHONY: demo test release check bench screenshots clean

demo: $(VENV)/.demo
	@exec $(BIN)/personal-viz demo

test: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --browser
	$(PYTEST) -m "not release and not bench and not gpu"

# Minutes of simulations and golden sets; pytest's exit code 5 says that no test has the mark.
release: $(VENV)/.test
	@$(PYTEST) -m release || test $$? = 5

check: $(VENV)/.dev
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/pyright
	$(PYTEST) -m "not release and not bench and not gpu and not slow and not browser"

bench: $(VENV)/.test
	$(BIN)/personal-viz bench sim
	$(BIN)/personal-viz bench recordings
	$(BIN)/personal-viz bench grounding
	$(BIN)/personal-viz bench study --parts store load browser
	$(BIN)/python -m pytest -m bench

screenshots: $(VENV)/.test
	@$(PYTHON) .ci/check_machine.py --browser
	$(BIN)/python -m personal_viz.screenshots

$(VENV)/.demo: pyproject.toml constraints.txt
	@$(PYTHON) .ci/check_machine.py
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV) (about 3 GB, some minutes the first time)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt torch $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX))
	@$(BIN)/python -c "import importlib.metadata as m; print('torch', m.version('torch'))"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.test: $(VENV)/.demo
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test]"
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	@touch $@

clean:
	rm -rf $(VENV) build *.egg-info
