# make demo   sets everything up and runs the main job on the embedded default
# make test   sets everything up and runs the tests
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
GPLVM_VENV := .venv-gplvm
PRIOR_VENV := .venv-prior
FUZZ_VENV := .venv-fuzz
DOCS_VENV := .venv-docs
GPLVM_STAMP := $(GPLVM_VENV)/.installed
PRIOR_STAMP := $(PRIOR_VENV)/.installed
FUZZ_STAMP := $(FUZZ_VENV)/.installed
DOCS_STAMP := $(DOCS_VENV)/.installed
QUALITY_VENV := .venv-quality
QUALITY_STAMP := $(QUALITY_VENV)/.installed

# Each supported Blender: the Python and the numpy that it brings.
PYTHON311 ?= python3.11
PYTHON313 ?= python3.13
BPY_VERSIONS := 4.2 4.5 5.0 5.2
BPY_TESTS := $(BPY_VERSIONS:%=bpy-test-%)
PYTHON_OF_4.2 := $(PYTHON311)
PYTHON_OF_4.5 := $(PYTHON311)
PYTHON_OF_5.0 := $(PYTHON311)
PYTHON_OF_5.2 := $(PYTHON313)
NUMPY_OF_4.2 := 1.24
NUMPY_OF_4.5 := 1.26
NUMPY_OF_5.0 := 1.26
NUMPY_OF_5.2 := 2.3

.PHONY: demo test bpy-test $(BPY_TESTS) gplvm-test prior-test check window-test window-walkthrough window-bench fuzz fuzz-guided fuzz-guided-test operator-fuzz operator-fuzz-window take-fuzz setup-check-bench batch-bench retarget-bench frame-bench latency-bench start-bench sketch-sample sketch-live-bench write-faults vmc-flood camera-faults session-soak drawings pictures docs extension release coverage mutation train-prior bench-priors clean

# bpy, Blender as a module, writes the .blend of the demo and runs the add-on's tests. It is asked for together with
# the rest, so that one numpy serves all; where there is no wheel of it for this Python, both are left out.
$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]' 'bpy>=4.2' \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(STAMP)
	$(BIN)/perfanim demo --out out/demo

# One thread a process for linear algebra: the processes share the cores already.
test: export OPENBLAS_NUM_THREADS := 1
test: $(STAMP)
	$(BIN)/python -m pytest tests --ignore tests/window --ignore tests/gplvm --ignore tests/prior --ignore tests/fuzz_guided -n auto --dist loadfile --no-loadscope-reorder

# The add-on's tests on each supported Blender as a module, with the wheels of the extension, one environment each. The
# project itself is there without its requirements: its numpy would be newer than that of Blender 4.2.
bpy-test: $(BPY_TESTS)

$(BPY_TESTS): bpy-test-%:
	@$(PYTHON_OF_$*) -c '' 2>/dev/null || { echo 'bpy $* is left out: $(PYTHON_OF_$*) is not there'; exit 0; }; \
	$(MAKE) .venv-bpy-$*/.installed && .venv-bpy-$*/bin/python -m pytest tests/addon -n auto --dist loadfile

.venv-bpy-%/.installed: pyproject.toml tools/wheels.txt
	$(PYTHON_OF_$*) -m venv .venv-bpy-$*
	.venv-bpy-$*/bin/python -m pip install --quiet --disable-pip-version-check --requirement tools/wheels.txt \
	  'bpy==$*.*' 'numpy==$(NUMPY_OF_$*).*' pytest pytest-xdist
	.venv-bpy-$*/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

# GPy wants an older scipy than the rest is tested with.
$(GPLVM_STAMP): pyproject.toml
	$(PYTHON) -m venv $(GPLVM_VENV)
	$(GPLVM_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[gplvm]' pytest
	touch $@

# JAX wants a newer NumPy than the rest is tested with.
$(PRIOR_STAMP): pyproject.toml
	$(PYTHON) -m venv $(PRIOR_VENV)
	$(PRIOR_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[prior]' pytest
	touch $@

# Trains the motion prior that is shipped, on DATA/cmu. The errors of people left out (PRIOR_FOLD) stand for those of anybody unseen.
PRIOR_FOLD ?= 07 29 91
train-prior: export OPENBLAS_NUM_THREADS := 1
train-prior: $(STAMP) $(PRIOR_STAMP)
	$(BIN)/perfanim database build $(DATA)/cmu --out out/prior/cmu.pfdb
	$(PRIOR_VENV)/bin/python tools/train_prior.py --database out/prior/cmu.pfdb --unseen $(PRIOR_FOLD) --out out/prior/fold.npz
	$(BIN)/perfanim database build assets/motion --out out/prior/embedded.pfdb
	$(PRIOR_VENV)/bin/python tools/train_prior.py --database out/prior/cmu.pfdb out/prior/embedded.pfdb --further out/prior/fold.npz \
	  --out out/prior/everybody.npz
	$(PRIOR_VENV)/bin/python tools/train_prior.py --database out/prior/cmu.pfdb out/prior/embedded.pfdb \
	  --further out/prior/everybody.npz --seed 2 --out assets/motion_prior.npz

# The priors of `bench accuracy` into BENCH/databases: none has seen the performers of its takes, nor are the errors that
# its deviations come from theirs. 6,000 steps each, half an hour in all.
BENCH ?= out/bench
PRIOR_FOLDS := 07_49_09:29_91_135 91_05_86:07_29_131 29_127_35_13:07_91_49 14_03:07_29_91 16_135_131:07_29_91
bench-priors: export OPENBLAS_NUM_THREADS := 1
bench-priors: $(STAMP) $(PRIOR_STAMP)
	$(BIN)/perfanim database build $(DATA)/cmu --out out/prior/cmu.pfdb
	for fold in $(PRIOR_FOLDS); do \
	  left_out=$${fold%:*} unseen=$${fold#*:}; \
	  $(PRIOR_VENV)/bin/python tools/train_prior.py --database out/prior/cmu.pfdb --steps 6000 \
	    --without $$(echo $$left_out | tr _ ' ') --unseen $$(echo $$unseen | tr _ ' ') \
	    --out $(BENCH)/databases/motion_prior_without_$$left_out.npz || exit; \
	done

gplvm-test: $(GPLVM_STAMP)
	$(GPLVM_VENV)/bin/python -m pytest tests/gplvm

# Two steps of the prior's training, twice with a seed.
prior-test: export OPENBLAS_NUM_THREADS := 1
prior-test: $(PRIOR_STAMP)
	$(PRIOR_VENV)/bin/python -m pytest tests/prior

$(DOCS_STAMP): pyproject.toml
	$(PYTHON) -m venv $(DOCS_VENV)
	$(DOCS_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

$(QUALITY_STAMP): pyproject.toml
	$(PYTHON) -m venv $(QUALITY_VENV)
	$(QUALITY_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,quality]' 'bpy>=4.2' \
	  || $(QUALITY_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,quality]'
	touch $@

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	mkdir -p .mypy_cache/path && ln -sfn $(CURDIR) .mypy_cache/path/perfanim # as the tools import it
	MYPYPATH=.mypy_cache/path $(BIN)/mypy --follow-imports silent tools
	$(BIN)/lint-imports

# Needs BLENDER: a command that runs its arguments where a Blender with a window can be started.
window-test: $(STAMP)
	$(BIN)/python -m pytest tests/window -m 'not benchmark and not walkthrough'

# The same window, by mouse and keyboard: a take on all kinds of characters, a sword, and three cameras calibrated with a
# ChArUco board and markers on the floor. The pictures are in out/window.
window-walkthrough: $(STAMP)
	$(BIN)/python -m pytest tests/window -m walkthrough

# The same window: how often the bones change live, against a bare timer; fails below 0.9 of it.
window-bench: $(STAMP)
	$(BIN)/python -m pytest tests/window -m benchmark

# Kills 100 captures at random moments and looks what their takes have kept; takes half an hour. Linux only.
take-fuzz: $(STAMP)
	$(BIN)/python tools/take_fuzz.py

# 1,000 kills and full disks while takes, databases, notes, motion and batches are written; takes 40 minutes. POSIX only.
COUNT ?= 1000
write-faults: export OPENBLAS_NUM_THREADS := 1
write-faults: $(STAMP)
	$(BIN)/python tools/write_faults.py --count $(COUNT)

# 100,000 packets a second of three kinds, for a minute each, at the port of a running capture. Linux only.
FLOOD_SECONDS ?= 60
vmc-flood: export OPENBLAS_NUM_THREADS := 1
vmc-flood: $(STAMP)
	$(BIN)/python tools/vmc_flood.py --seconds $(FLOOD_SECONDS)

# One of two cameras fails in nine ways, 20 times each; takes a quarter of an hour.
camera-faults: $(STAMP)
	$(BIN)/python tools/camera_faults.py --count 20

# A capture without an end for MINUTES, or of so many FRAMES however long they take: growth of memory and of a frame's
# time. Linux only.
MINUTES ?= 15
METHOD ?= best
session-soak: export OPENBLAS_NUM_THREADS := 1
session-soak: $(STAMP)
	$(BIN)/python tools/session_soak.py $(if $(FRAMES),--frames $(FRAMES),--minutes $(MINUTES)) --method $(METHOD)

# Damaged inputs for every reader, packet, message and command line, for SECONDS; faults are kept in out/fuzz. Linux only.
SECONDS ?= 3600
SEED ?= 1
fuzz: export OPENBLAS_NUM_THREADS := 1
fuzz: $(STAMP)
	cd tools && ../$(BIN)/python -m fuzz --seconds $(SECONDS) --seed $(SEED) --out ../out/fuzz

# Inputs that reach new branches of BVH, C3D, recorded takes and all TOML files are changed further, by libFuzzer; seconds
# for all together. The tiny ones that go furthest are left in out/fuzz/guided. Linux only.
$(FUZZ_STAMP): pyproject.toml
	$(PYTHON) -m venv $(FUZZ_VENV)
	$(FUZZ_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[fuzz]' pytest
	touch $@

fuzz-guided: export OPENBLAS_NUM_THREADS := 1
fuzz-guided: $(FUZZ_STAMP)
	cd tools && ../$(FUZZ_VENV)/bin/python -m fuzz.guided --seconds $(SECONDS) --seed $(SEED) --out ../out/fuzz --keep ../out/fuzz/guided

fuzz-guided-test: export OPENBLAS_NUM_THREADS := 1
fuzz-guided-test: $(FUZZ_STAMP)
	$(FUZZ_VENV)/bin/python -m pytest tests/fuzz_guided

# Random sequences of the extension's buttons, settings, undo, files, deleting: what is raised, or left. Linux only; needs bpy.
SEQUENCES ?= 10000
operator-fuzz: export OPENBLAS_NUM_THREADS := 1
operator-fuzz: $(STAMP)
	cd tools && ../$(BIN)/python -m operator_fuzz --sequences $(SEQUENCES) --seed $(SEED)

# The same in a window, each while a capture is live, with BLENDER as for window-test; 300 take an hour. Linux only.
WINDOW_SEQUENCES ?= 300
operator-fuzz-window: export OPENBLAS_NUM_THREADS := 1
operator-fuzz-window: $(STAMP)
	cd tools && ../$(BIN)/python -m operator_fuzz --window --sequences $(WINDOW_SEQUENCES) --seed $(SEED)

# 200 takes with faults through perfanim batch in all ways; takes a quarter of an hour. DATA holds cmu/ (ASF/AMC).
batch-bench: $(STAMP)
	$(BIN)/python tools/batch_bench.py --data $(DATA) --out out/batch-bench

# Random simulated studios, 12 of each fault and healthy ones, through the check before a capture; a quarter of an hour.
setup-check-bench: export OPENBLAS_NUM_THREADS := 1
setup-check-bench: $(STAMP)
	$(BIN)/python tools/setup_check_bench.py --studios 12 --seed 71

# A walk and boxing on all characters below DATA: bones found, where limbs point, twists, sliding feet. Needs bpy.
retarget-bench: $(STAMP)
	$(BIN)/python tools/retarget_bench.py --data $(DATA)

# From a marker frame's packet to the bones of the character, with 395,399 frames. DATA holds cmu/ and bandai/; needs bpy.
frame-bench: export OPENBLAS_NUM_THREADS := 1
frame-bench: $(STAMP)
	$(BIN)/python tools/frame_bench.py --data $(DATA)

# From images in hand to the bones of the character through all processes, stage by stage; needs bpy.
latency-bench: export OPENBLAS_NUM_THREADS := 1
latency-bench: $(STAMP)
	$(BIN)/python tools/latency_bench.py

# From the start of a capture to its first pose, and from a killed solver to the next one; memory. Linux only.
start-bench: export OPENBLAS_NUM_THREADS := 1
start-bench: $(STAMP)
	$(BIN)/python tools/start_bench.py $(if $(DATABASE),--database $(DATABASE))

# A .blend with a sketch of twelve keys (walk to a mark, turn, two punches), and pictures of its motion; needs bpy.
sketch-sample: $(STAMP)
	$(BIN)/python tools/sketch_sample.py --out out/sketch/sketch-sample.blend --render out/sketch

# Live edits of that sketch over 250 frames: first picture, whole motion, and how long Blender is held up.
sketch-live-bench: sketch-sample
	$(BIN)/python tools/sketch_live_bench.py out/sketch/sketch-sample.blend

# The drawings in docs/drawings, from marker sets and camera places.
drawings: $(STAMP)
	$(BIN)/python tools/make_drawings.py

# The pictures of the README: a moving one, and the sidebar and the guide in a real window, with BLENDER as for window-test.
pictures: export OPENBLAS_NUM_THREADS := 1
pictures: export PERFANIM_KEEP_PICTURES := 1
pictures: $(STAMP)
	$(BIN)/python tools/moving_picture.py --out docs/pictures/live.webp
	$(BIN)/python -m pytest tests/window -m pictures

# The documents as pages in out/docs: drawings up to date, every command and script run, no warning, no broken link.
docs: export OPENBLAS_NUM_THREADS := 1
docs: $(STAMP) $(DOCS_STAMP)
	$(BIN)/python tools/make_drawings.py --check
	$(BIN)/python tools/run_documents.py
	rm -rf out/docs # pages made from the code are not seen to be old
	$(DOCS_VENV)/bin/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs out/docs

extension: $(STAMP)
	$(BIN)/python tools/build_extension.py --out dist

# All archives, SHA256SUMS and release-notes.md in dist; prints the largest parts of each archive.
release: $(STAMP)
	$(BIN)/python tools/make_release.py --out dist

# Lines of core/ that its tests run; pages in out/coverage. Takes twice as long as the tests.
coverage: export OPENBLAS_NUM_THREADS := 1
coverage: $(QUALITY_STAMP)
	rm -rf out/coverage
	$(QUALITY_VENV)/bin/python -m coverage run -m pytest tests/core
	$(QUALITY_VENV)/bin/python -m coverage combine --quiet
	$(QUALITY_VENV)/bin/python -m coverage html --quiet --directory out/coverage/pages
	$(QUALITY_VENV)/bin/python -m coverage report

# Share of small changes of the code that its tests notice: cosmic-ray with MUTATION's modules (docs/development.md).
MUTATION ?= tests/mutation.toml
mutation: export OPENBLAS_NUM_THREADS := 1
mutation: $(QUALITY_STAMP)
	mkdir -p out
	$(QUALITY_VENV)/bin/cosmic-ray init $(MUTATION) out/mutation.sqlite
	$(QUALITY_VENV)/bin/cr-filter-pragma out/mutation.sqlite
	$(QUALITY_VENV)/bin/cosmic-ray exec $(MUTATION) out/mutation.sqlite
	$(QUALITY_VENV)/bin/cr-report out/mutation.sqlite

clean:
	rm -rf $(VENV) $(GPLVM_VENV) $(PRIOR_VENV) $(DOCS_VENV) $(QUALITY_VENV) .venv-bpy-* out dist docs/api docs/toml-files.md
