# make environment   .venv with everything pinned      make test        all tests
# make demo          reconstruct the sample capture    make lint        ruff
# make benchmark     docs/benchmarks.md of SCENES="DIR DIR=PAPERNAME …" [SETTINGS="…"] [PRESET=draft]
# make benchmark-kernels, make benchmark-curves: docs/kernels.md, docs/curves.md
# make benchmark-scaling docs/scaling.md of CAPTURE (in NeRF-synthetic's layout)
# make benchmark-promises docs/promises.md of SCENES: limits kept, times left [LIMITS="60 120"]
# make benchmark-step    a step of the fit on every path of a device [DEVICE=cuda] [CAPTURE=DIR]
# make extension     dist/….zip, to install in Blender make clean       remove what was made
#
# PYTHON=…           the Python to build .venv with, 3.11 or 3.13: make demo PYTHON=python3.13
# PIP_ARGUMENTS=…    more for pip install, such as --extra-index-url with PyTorch's index for CPUs
# WORKERS=…          processes that run tests side by side, 2 unless said; each takes up to 2 GB
# NMF_REAL_BLENDER=… a program that starts a real Blender; with it, `make test` tests there too

SUPPORTED = import sys, venv; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))
PYTHON ?= $(shell for p in python3.11 python3.13 python3; do \
	"$$p" -c '$(SUPPORTED)' 2>/dev/null && echo "$$p" && break; done)
PIP_ARGUMENTS ?=
NMF_REAL_BLENDER ?=
WORKERS ?= 2
BIN := .venv/bin
STAMP := .venv/.complete
REQUIREMENTS := solver/requirements.txt requirements/development.txt requirements/constraints.txt
BLENDER_TOOL = $(shell find .venv/lib -path '*bl_pkg/cli/blender_ext.py' 2>/dev/null | head -n 1)

.PHONY: help environment demo clean-demo benchmark benchmark-kernels benchmark-curves benchmark-scaling benchmark-promises benchmark-step test test-solver test-blender test-window lint extension clean

help:
	@sed -n '/^#/!q; s/^# \{0,1\}//p' Makefile

environment: $(STAMP)

$(STAMP): $(REQUIREMENTS)
	@"$(PYTHON)" -c '$(SUPPORTED)' 2>/dev/null || { echo "Python 3.11 or 3.13 with its venv module" \
		"is needed: install one, or name it: make environment PYTHON=/path/to/python" >&2; exit 1; }
	@echo "Building .venv with $$($(PYTHON) --version); the first time, this downloads 1 to 4 GB."
	@test -x $(BIN)/pip || "$(PYTHON)" -m venv --clear .venv || { \
		echo "On Debian and Ubuntu, install the package python3-venv." >&2; exit 1; }
	$(BIN)/python -m pip install --disable-pip-version-check --quiet $(PIP_ARGUMENTS) \
		-c requirements/constraints.txt -r requirements/development.txt
	@touch $(STAMP)

# Compiled first, which happens once on a machine: the demo's time limit is for the reconstruction.
demo: $(STAMP)
	@$(BIN)/python -m solver compile
	@$(BIN)/python samples/demo.py

clean-demo:
	rm -rf demo

# Blender's and the solver's are apart: bpy and torch bring threading libraries of their own. All run; any may
# fail the target. Windows share a screen and wait for it, so that Blender's others run beside them.
test: $(STAMP)
	@status=0; $(MAKE) --no-print-directory test-solver || status=1; \
	told=$$(mktemp); $(MAKE) --no-print-directory test-window >"$$told" 2>&1 & window=$$!; \
	$(MAKE) --no-print-directory test-blender || status=1; \
	wait $$window || status=1; cat "$$told"; rm "$$told"; exit $$status

# A process that crashed is not replaced: pytest-xdist would wait for the tests of its file for ever. Which
# files come first is said in tests/conftest.py.
SIDE_BY_SIDE = -n $(WORKERS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0

test-solver: $(STAMP)
	$(BIN)/python -m solver compile
	$(BIN)/python -m pytest -q tests --ignore=tests/blender --ignore=tests/gui $(SIDE_BY_SIDE)

test-blender: $(STAMP)
	$(BIN)/python -m pytest -q tests/blender $(SIDE_BY_SIDE)

test-window: $(STAMP)
	@if [ -z "$(NMF_REAL_BLENDER)" ]; then \
		echo "NMF_REAL_BLENDER is not set: the tests in a real Blender were left out."; \
	elif [ ! -d tests/gui ]; then echo "There are no tests/gui to run in a real Blender."; \
	else export NMF_REAL_BLENDER="$(NMF_REAL_BLENDER)"; $(BIN)/python -m pytest -q tests/gui || { \
		echo "Once more: on a busy machine a window can miss a click."; \
		$(BIN)/python -m pytest -q tests/gui; }; fi

SCENES ?= samples/duck
SETTINGS ?= all
PRESET ?= draft
benchmark: $(STAMP)
	$(BIN)/python benchmarks/quality.py --scenes $(SCENES) --settings $(SETTINGS) --preset $(PRESET)

benchmark-kernels: $(STAMP)
	$(BIN)/python benchmarks/kernels.py --out docs/kernels.md

benchmark-curves: $(STAMP)
	$(BIN)/python benchmarks/curves.py --scenes $(SCENES) --preset $(PRESET)

DEVICE ?= cpu
CAPTURE ?= samples/duck
benchmark-step: $(STAMP)
	$(BIN)/python benchmarks/step.py --device $(DEVICE) --capture $(CAPTURE) --preset $(PRESET)

benchmark-scaling: $(STAMP)
	$(BIN)/python benchmarks/scaling.py --scene $(CAPTURE) --preset $(PRESET)

LIMITS ?= 60 120
benchmark-promises: $(STAMP)
	$(BIN)/python benchmarks/promises.py --scenes $(SCENES) --limits $(LIMITS) --preset $(PRESET)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

extension: $(STAMP)
	@mkdir -p dist
	$(BIN)/python "$(BLENDER_TOOL)" validate .
	$(BIN)/python "$(BLENDER_TOOL)" build --source-dir . --output-dir dist

clean: clean-demo
	rm -rf .venv build dist .pytest_cache .ruff_cache .hypothesis
