# make demo   sets everything up and runs the main job on the embedded default
# make test   sets everything up and runs the tests
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test check window-test extension clean

# bpy, Blender as a module, writes the .blend of the demo and runs the add-on's tests. It is asked for together with
# the rest, so that one numpy serves all; where there is no wheel of it for this Python, both are left out.
$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]' 'bpy>=4.2' \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(STAMP)
	$(BIN)/perfanim demo --out out/demo

test: $(STAMP)
	$(BIN)/python -m pytest tests --ignore tests/window

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Needs BLENDER: a command that runs its arguments where a Blender with a window can be started.
window-test: $(STAMP)
	$(BIN)/python -m pytest tests/window

extension: $(STAMP)
	$(BIN)/python tools/build_extension.py --out dist

clean:
	rm -rf $(VENV) out dist
