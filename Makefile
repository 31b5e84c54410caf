# Everything a newcomer needs: `make environment`, `make demo`, `make test`.
# PYTHON may name another interpreter: make PYTHON=python3.13 demo

PYTHON ?= $(shell for p in python3.11 python3.13 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.complete
BLENDER_TOOL = $(shell find $(VENV)/lib -path '*bl_pkg/cli/blender_ext.py' 2>/dev/null | head -n 1)

.PHONY: environment demo test lint extension clean

environment: $(STAMP)

$(STAMP): solver/requirements.txt requirements/development.txt
	@test -n "$(PYTHON)" || { echo "Python 3.11 or 3.13 is needed: install one, or make PYTHON=/path/to/python"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check -r solver/requirements.txt -r requirements/development.txt
	touch $(STAMP)

demo: environment
	$(BIN)/python samples/demo.py

# Two processes: bpy and torch bring threading libraries of their own. Both run; either may fail the target.
test: environment
	@status=0; \
	$(BIN)/python -m pytest -q tests --ignore tests/blender || status=1; \
	$(BIN)/python -m pytest -q tests/blender || status=1; \
	exit $$status

lint: environment
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

extension: environment
	mkdir -p dist
	$(BIN)/python "$(BLENDER_TOOL)" validate .
	$(BIN)/python "$(BLENDER_TOOL)" build --source-dir . --output-dir dist

clean:
	rm -rf $(VENV) demo dist build .pytest_cache .ruff_cache
