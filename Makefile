# Each target makes what it needs: `make demo` and `make test` work on a fresh clone with Python >= 3.11 and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Half of the time of a test is waiting for devices.
WORKERS ?= 4
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.docs-installed

# The tests start the program hundreds of times: without its compiled files each start takes half as long again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check docs pictures bench trials monkey clean

demo: $(STAMP)
	rm -rf demo-out
	$(BIN)/rigctl demo --out demo-out

# All but the tests that take more than some five seconds of processor each: `pytest -m slow`, which .ci/run adds.
test: $(STAMP)
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m "not slow" tests

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The site, in docs/_build/html; warnings are errors. Once installed it needs no network.
docs: $(DOCS_STAMP)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html

# The pictures of the pages, by the commands that the pages show; needs Chromium and the extras browser and infer.
pictures: $(STAMP)
	$(BIN)/python -m docs.make_pictures

# Writes the table of docs/benchmarks.md; `python -m benchmarks.peers` makes the programs of others that are timed beside
# ours.
bench: $(STAMP)
	$(BIN)/python -m benchmarks.page

trials: $(STAMP)
	$(BIN)/python -m benchmarks.trials

# CASES=5000 SEED=0: what is tried, and from which seed on.
monkey: $(STAMP)
	$(BIN)/python -m tests.monkey --cases $(or $(CASES),5000) --first-seed $(or $(SEED),0)

clean:
	rm -rf $(VENV) demo-out docs/_build docs/made

$(STAMP): pyproject.toml constraints.txt .ci/make-venv
	PYTHON="$(PYTHON)" .ci/make-venv "$(VENV)"
	touch $@

$(DOCS_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch $@
