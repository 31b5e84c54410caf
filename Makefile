# make environment   .venv with everything pinned         make test        all tests
# make demo          reconstruct the sample capture       make lint        ruff
# make extension     dist/….zip, to install in Blender    make clean       remove what was made
#
# PYTHON=…          the Python to build .venv with: 3.11 or 3.13
# PIP_ARGUMENTS=…   more for pip install, such as --extra-index-url with PyTorch's index for CPUs

PYTHON ?=
PIP_ARGUMENTS ?=
RUN = .venv/bin/python
STAMP = .venv/.complete
REQUIREMENTS = solver/requirements.txt $(wildcard requirements/*.txt)

.PHONY: help environment demo clean-demo test test-solver test-blender test-window lint extension clean

help:
	@sed -n '1,3s/^# //p' Makefile

environment: $(STAMP)

$(STAMP): $(REQUIREMENTS)
	@python="$(PYTHON)"; for name in $$python python3.11 python3.13 python3; do \
		"$$name" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' \
			2>/dev/null && python="$$name" && break || test "$$name" != "$$python" \
			|| { echo "$$name is not a working Python 3.11 or 3.13." >&2; exit 1; }; done; \
	test -n "$$python" || { echo "Python 3.11 or 3.13 is needed and neither was found;" \
		"install one, or name it: make environment PYTHON=/path/to/python3.11" >&2; exit 1; }; \
	echo "Building .venv with $$($$python --version); the first time this downloads about 1 GB."; \
	test -x $(RUN) || "$$python" -m venv .venv || { echo "Making .venv failed; on Debian and" \
		"Ubuntu install the package python3-venv." >&2; rm -rf .venv; exit 1; }
	$(RUN) -m pip install --disable-pip-version-check --quiet $(PIP_ARGUMENTS) \
		-c requirements/constraints.txt -r requirements/test.txt
	@touch $(STAMP)

demo: $(STAMP)
	@$(RUN) samples/demo.py

clean-demo:
	rm -rf demo

# Blender as a module and the solver's libraries in one process can clash, so they are tested apart;
# both run even if the first fails.
test: $(STAMP)
	@status=0; \
	$(MAKE) --no-print-directory test-solver || status=1; \
	$(MAKE) --no-print-directory test-blender || status=1; \
	$(MAKE) --no-print-directory test-window || status=1; \
	exit $$status

test-solver: $(STAMP)
	$(RUN) -m pytest --ignore=tests/blender --ignore=tests/gui

test-blender: $(STAMP)
	$(RUN) -m pytest tests/blender

# In a real Blender with a window: NMF_REAL_BLENDER names the program that starts one.
test-window: $(STAMP)
	@if [ -n "$$NMF_REAL_BLENDER" ]; then $(RUN) -m pytest tests/gui; \
	else echo "NMF_REAL_BLENDER is not set: the tests in a real Blender were not run."; fi

lint: $(STAMP)
	$(RUN) -m ruff check

extension: $(STAMP)
	@mkdir -p dist
	@tool=$$($(RUN) -c 'import bpy, pathlib; print(next(pathlib.Path(bpy.utils.resource_path("LOCAL")).rglob("blender_ext.py")))') \
		&& $(RUN) "$$tool" validate . && $(RUN) "$$tool" build --source-dir . --output-dir dist

clean: clean-demo
	rm -rf .venv build dist .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
