# Each target does all its own set-up on a machine that has Python 3.11 or newer and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# One BLAS thread: two spin against each other on a busy two-core machine (docs/decisions/0004).
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test check bench clean
.DEFAULT_GOAL := test

# The stamp lives inside the environment, so deleting the environment deletes the stamp.
$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "TruePose needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

demo: $(VENV)/.installed
	$(BIN)/truepose demo

check: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

test: check
	$(BIN)/python -m pytest

# The peers come last: each is installed in an environment of its own under .bench (2 GB, some minutes).
bench: $(VENV)/.installed
	$(BIN)/python -m tests.benchmarks
	$(BIN)/python -m tests.benchmarks peers

clean:
	rm -rf $(VENV) .bench build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
