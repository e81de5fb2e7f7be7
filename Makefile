# The targets, with what they need: `make help`.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
PIP_INSTALL := python -m pip install --quiet --disable-pip-version-check
NO_BPY = echo 'no wheel of bpy for this Python: the add-on is not tested'

# Each supported Blender: the Python and the numpy that it brings.
PYTHON311 ?= python3.11
PYTHON313 ?= python3.13
BPY ?= 4.2 4.5 5.0 5.2
PYTHON_OF_4.2 := $(PYTHON311)
PYTHON_OF_4.5 := $(PYTHON311)
PYTHON_OF_5.0 := $(PYTHON311)
PYTHON_OF_5.2 := $(PYTHON313)
NUMPY_OF_4.2 := 1.24
NUMPY_OF_4.5 := 1.26
NUMPY_OF_5.0 := 1.26
NUMPY_OF_5.2 := 2.3

# One thread a process for linear algebra: the processes share the cores already.
export OPENBLAS_NUM_THREADS ?= 1
# Compiled modules are kept, or each of the many processes would compile them anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo test long-test check bpy-test window-test extras-test kernel docs extension release coverage mutation \
	bench-priors train-prior soak fuzz operator-fuzz clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.* ## /\1\t/p' $(MAKEFILE_LIST) | expand -t 15

demo: $(STAMP) ## the main job with a simulated performer, results in out/demo
	$(BIN)/perfanim demo --out out/demo

TESTS := tests --ignore tests/kernel --ignore tests/window --ignore tests/gplvm --ignore tests/prior --ignore tests/fuzz_guided \
	--ignore tests/soak/test_tracker_floods.py -n auto --dist loadfile --no-loadscope-reorder

test: $(STAMP) ## all tests that need no window, but the long ones
	$(BIN)/python -m pytest $(TESTS) -m 'not long'

long-test: $(STAMP) ## whole benchmarks, films and recordings
	$(BIN)/python -m pytest $(TESTS) -m long
	$(BIN)/python -m pytest tests/soak/test_tracker_floods.py # alone: a flood needs the processors

check: $(STAMP) ## linter, formatter, types, imports between packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	mkdir -p .mypy_cache/path && ln -sfn $(CURDIR) .mypy_cache/path/perfanim # as the tools import it
	MYPYPATH=.mypy_cache/path $(BIN)/mypy --follow-imports silent tools
	$(BIN)/lint-imports

bpy-test: $(BPY:%=bpy-test-%) ## the add-on on each supported Blender as a module; BPY="4.2 5.2" for some

# With the wheels of the extension. The project itself is there without its requirements: its numpy would be newer than
# that of Blender 4.2.
bpy-test-%:
	@$(PYTHON_OF_$*) -c '' 2>/dev/null || { echo 'bpy $* is left out: $(PYTHON_OF_$*) is not there'; exit 0; }; \
	$(MAKE) .venv-bpy-$*/.installed && .venv-bpy-$*/bin/python -m pytest tests/addon -n auto --dist loadfile

MARK ?= not benchmark and not walkthrough
window-test: $(STAMP) ## the add-on in a window (BLENDER=COMMAND that starts one), or WINDOWS=2; MARK=walkthrough|benchmark|pictures
	$(if $(filter pictures,$(MARK)),PERFANIM_KEEP_PICTURES=1) $(BIN)/python -m pytest tests/window -m '$(MARK)' $(if $(WINDOWS),-n $(WINDOWS) --dist loadfile --no-loadscope-reorder)

EXTRAS := gplvm prior fuzz kernel
KERNEL := PERFANIM_KERNEL=$(CURDIR)/out/kernel
# Zig has no address sanitizer, so the second kernel is built by the system's C compiler.
extras-test: $(STAMP) $(EXTRAS:%=.venv-%/.installed) ## GPLVM, training of the prior, guided fuzzing, the kernel (Linux, x86-64)
	.venv-gplvm/bin/python -m pytest tests/gplvm
	.venv-prior/bin/python -m pytest tests/prior
	.venv-fuzz/bin/python -m pytest tests/fuzz_guided
	.venv-kernel/bin/python tools/build_kernel.py --platform linux-x64 --out out/kernel
	$(KERNEL) $(BIN)/python -m pytest tests/kernel
	.venv-kernel/bin/python tools/build_kernel.py --out out/kernels
	.venv-kernel/bin/python tools/build_kernel.py --platform linux-x64 --out out/kernel --sanitize
	$(KERNEL) LD_PRELOAD=$$(cc -print-file-name=libasan.so) ASAN_OPTIONS=detect_leaks=0 $(BIN)/python -m pytest tests/kernel

kernel: .venv-kernel/.installed ## the compiled kernel for all platforms, or PLATFORM=linux-x64|linux-arm64|windows-x64|...
	.venv-kernel/bin/python tools/build_kernel.py $(if $(PLATFORM),--platform $(PLATFORM))

docs: $(STAMP) .venv-docs/.installed ## the manual in out/docs; a warning or a wrong command is an error
	$(BIN)/python tools/make_drawings.py
	$(BIN)/python -m pytest docs -n 2
	rm -rf out/docs # pages made from the code are not seen to be old
	.venv-docs/bin/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs out/docs

extension: $(STAMP) ## the extension's archives in dist; PLATFORM=linux-x64|windows-x64|macos-arm64|macos-x64 for one
	$(BIN)/python tools/build_extension.py --out dist $(if $(PLATFORM),--platform $(PLATFORM))

release: $(STAMP) ## the archives with checksums and notes of the changelog
	$(BIN)/python tools/make_release.py --out dist

coverage: .venv-quality/.installed ## lines of core/ that its tests run, pages in out/coverage
	rm -rf out/coverage
	.venv-quality/bin/python -m coverage run -m pytest tests/core
	.venv-quality/bin/python -m coverage combine --quiet
	.venv-quality/bin/python -m coverage html --quiet --directory out/coverage/pages
	.venv-quality/bin/python -m coverage report

MUTATION ?= tests/mutation.toml
mutation: .venv-quality/.installed ## small changes of a module that no test notices; MUTATION=FILE names module and tests
	mkdir -p out && rm -f out/mutation.sqlite
	.venv-quality/bin/cosmic-ray init $(MUTATION) out/mutation.sqlite
	.venv-quality/bin/cosmic-ray exec $(MUTATION) out/mutation.sqlite
	.venv-quality/bin/cr-report out/mutation.sqlite

# None of these priors has seen the performers of its takes, nor do its deviations come from their errors. Half an hour.
OUT ?= out/bench
PRIOR_FOLDS := 07_49_09:29_91_135 91_05_86:07_29_131 29_127_35_13:07_91_49 14_03:07_29_91 16_135_131:07_29_91
bench-priors: $(STAMP) .venv-prior/.installed ## the priors of `perfanim bench accuracy` into OUT (DATA=DIR with cmu/)
	$(BIN)/perfanim database build $(DATA)/cmu --out out/prior/cmu.pfdb
	for fold in $(PRIOR_FOLDS); do \
	  left_out=$${fold%:*} unseen=$${fold#*:}; \
	  .venv-prior/bin/python tools/train_prior.py --database out/prior/cmu.pfdb --steps 6000 \
	    --without $$(echo $$left_out | tr _ ' ') --unseen $$(echo $$unseen | tr _ ' ') \
	    --out $(OUT)/databases/motion_prior_without_$$left_out.npz || exit; \
	done

# The errors of people left out (07, 29, 91) stand for those of anybody unseen.
train-prior: $(STAMP) .venv-prior/.installed ## the prior in assets/ (DATA=DIR with cmu/), half an hour
	$(BIN)/perfanim database build $(DATA)/cmu --out out/prior/cmu.pfdb
	.venv-prior/bin/python tools/train_prior.py --database out/prior/cmu.pfdb --unseen 07 29 91 --out out/prior/fold.npz
	$(BIN)/perfanim database build assets/motion --out out/prior/embedded.pfdb
	.venv-prior/bin/python tools/train_prior.py --database out/prior/cmu.pfdb out/prior/embedded.pfdb \
	  --further out/prior/fold.npz --out out/prior/everybody.npz
	.venv-prior/bin/python tools/train_prior.py --database out/prior/cmu.pfdb out/prior/embedded.pfdb \
	  --further out/prior/everybody.npz --seed 2 --out assets/motion_prior.npz

WHAT ?= takes
soak: $(STAMP) ## long trials: WHAT=takes|writes|trackers|cameras|session ARGS="--count N --seed N" (Linux)
	cd tests/helpers && ../../$(BIN)/python -m soak $(WHAT) $(ARGS)

INPUTS ?= 2000
SECONDS ?= 600
SEED ?= 1
fuzz: $(STAMP) ## INPUTS damaged inputs for every reader; GUIDED=yes SECONDS=N leads them to new branches (Linux)
ifdef GUIDED
	$(MAKE) .venv-fuzz/.installed
	cd tests/helpers && ../../.venv-fuzz/bin/python -m fuzzing.guided --seconds $(SECONDS) --seed $(SEED) --out ../../out/fuzz
else
	PERFANIM_FUZZ_INPUTS=$(INPUTS) $(BIN)/python -m pytest tests/fuzz --hypothesis-seed $(SEED) -n 2
endif

SEQUENCES ?= 10000
operator-fuzz: $(STAMP) ## random steps in Blender: SEQUENCES=N SEED=N; WINDOW=yes in a window while a capture is live (Linux)
	cd tools && ../$(BIN)/python -m operator_fuzz $(if $(WINDOW),--window) --sequences $(SEQUENCES) --seed $(SEED)

clean: ## remove environments and results
	rm -rf .venv .venv-* out dist docs/api docs/toml-files.md

# bpy, Blender as a module, writes the .blend of the demo and runs the add-on's tests. It is installed together with the
# rest, so that one numpy serves all.
$(STAMP): pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/$(PIP_INSTALL) --editable '.[dev]' 'bpy>=4.2' || { $(NO_BPY); $(BIN)/$(PIP_INSTALL) --editable '.[dev]'; }
	touch $@

.venv-quality/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-quality
	.venv-quality/bin/$(PIP_INSTALL) --editable '.[dev,quality]' 'bpy>=4.2'
	touch $@

.venv-kernel/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-kernel
	.venv-kernel/bin/$(PIP_INSTALL) 'ziglang>=0.17,<0.18'
	touch $@

.venv-bpy-%/.installed: pyproject.toml tools/wheels.txt
	$(PYTHON_OF_$*) -m venv .venv-bpy-$*
	.venv-bpy-$*/bin/$(PIP_INSTALL) --requirement tools/wheels.txt 'bpy==$*.*' 'numpy==$(NUMPY_OF_$*).*' \
	  pytest pytest-xdist hypothesis markdown-it-py
	.venv-bpy-$*/bin/$(PIP_INSTALL) --no-deps --editable .
	touch $@

# Extras with environments of their own: GPy wants an older scipy and JAX a newer numpy than the rest is tested with.
.venv-%/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-$*
	.venv-$*/bin/$(PIP_INSTALL) --editable '.[$*]' pytest
	touch $@
