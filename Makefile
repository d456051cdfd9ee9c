# Each target does all its own set-up on a machine that has Python 3.11 or newer and make.
PYTHON ?= python3
# Four test processes for two cores: many tests wait for devices (CONTRIBUTING.md).
JOBS ?= 4
# Python keeps what it has compiled, also where the surroundings forbid it: hundreds of processes import the program.
unexport PYTHONDONTWRITEBYTECODE
# How often `make steady` runs each test.
TIMES ?= 50
VENV := .venv
BIN := $(VENV)/bin
# One BLAS thread: two spin against each other on a busy two-core machine (CONTRIBUTING.md).
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test suite check style types docs notebooks pictures counterparts fuzz conformance sabotage mutants steady simulation long bench figures clean image
.DEFAULT_GOAL := test

# The stamp lives inside the environment, so deleting the environment deletes the stamp.
$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "TruePose needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

demo: $(VENV)/.installed
	$(BIN)/truepose demo

check: style types

style: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/python -m tests.prose --limits
	$(BIN)/lint-imports
	$(BIN)/ty check

types: $(VENV)/.installed
	$(BIN)/pyright

# The site of docs/, offline; a warning is an error. Open docs/build/index.html.
docs: $(VENV)/.installed
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/build

# The notebooks of docs/notebooks run anew and kept with what they print and draw; half a minute, and one more for the
# measured UR10, where TRUEPOSE_UR10 names the folder of its readings.
notebooks: $(VENV)/.installed
	$(BIN)/python -m tests.notebooks

# The pictures of docs/pictures taken anew, of today's report and operator page; three minutes, and Chromium.
pictures: $(VENV)/.installed
	$(BIN)/python -m tests.pictures

# Programs that nobody here wrote, for the tests to talk to; where one cannot be installed its tests skip.
counterparts: $(VENV)/.installed
	$(BIN)/python -m tests.counterparts

# The types of arguments are checked by `make check` and `make long` (CONTRIBUTING.md).
test: style
	-$(BIN)/python -m tests.counterparts
	$(MAKE) suite

suite: $(VENV)/.installed
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder

# An hour of spoiled files of every format; then 100,000 cases for every parser of a device, and as many requests.
fuzz: $(VENV)/.installed
	$(BIN)/python -m tests.fuzz 3600
	$(BIN)/python -m pytest tests/drivers tests/fuzz/test_requests.py -k test_any --hypothesis-profile=fuzz --timeout=0

# Every driver under every fault of the proxy, 400 questions each, about a quarter of an hour; and `make test`'s sample whole.
conformance: $(VENV)/.installed
	$(BIN)/python -m tests.conformance
	$(BIN)/python -m pytest -n $(JOBS) tests/conformance/test_faults.py --whole

# Each change of a list that breaks the program, in a copy: do the tests notice? About half an hour.
sabotage: $(VENV)/.installed
	$(BIN)/python -m tests.sabotage

# Small changes that nobody chose, forty of a file. An hour or two. It reports and does not end `make long`: docs/evidence/trust.md.
mutants: $(VENV)/.installed
	-$(BIN)/python -m tests.sabotage.mutants --sample 40

# Every test with a thread, a socket, a process or a device, again and again beside busy processes: hours, in as many
# sessions as one likes. What is through stands in .steady.jsonl; remove it to begin anew.
steady: $(VENV)/.installed
	$(BIN)/python -m tests.steady --times $(TIMES) --busy 4 --log .steady.jsonl

# What is run before an issue is closed, beside `make test`; half a night.
# Histories of a cell and its service that no test has seen yet: an hour from a seed that is printed.
simulation: $(VENV)/.installed
	$(BIN)/python -m tests.simulation --minutes 60 --seed $$(date +%s)

long: types notebooks conformance sabotage mutants steady simulation
	$(BIN)/python -m pytest tests/drivers -k test_any --hypothesis-profile=fuzz-short --timeout=0
	$(BIN)/python -m pytest -m whole --whole
	TRUEPOSE_KILLS=20 $(BIN)/python -m pytest tests/end_to_end/test_campaign_kill.py
	TRUEPOSE_MACHINE_EXAMPLES=100 $(BIN)/python -m pytest tests/acquisition/test_machine.py

# The peers come last: each is installed in an environment of its own under .bench (2 GB, some minutes).
bench: $(VENV)/.installed
	$(BIN)/python -m tests.benchmarks
	$(BIN)/python -m tests.benchmarks peers

# What is named is measured and entered in the history that docs/evidence/history.md shows; FIGURES="mutants conformance lines"
# for those. About three minutes as it is.
FIGURES ?= selection pairs robot_check:1
figures: $(VENV)/.installed
	$(BIN)/python -m tests.figures $(FIGURES)

# The container image, where a Docker daemon runs: docs/cell-pc/install.md.
image:
	docker build -f deploy/Dockerfile -t truepose .

clean:
	rm -rf $(VENV) .bench .counterparts build dist docs/build docs/made *.egg-info .pytest_cache .ruff_cache .hypothesis
