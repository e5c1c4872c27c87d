# Each target makes what it needs: `make demo` and `make test` work on a fresh clone with Python >= 3.11 and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test check bench trials monkey clean

demo: $(STAMP)
	rm -rf demo-out
	$(BIN)/rigctl demo --out demo-out

test: $(STAMP)
	$(BIN)/python -m pytest -n 2 tests

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(STAMP)
	for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

trials: $(STAMP)
	$(BIN)/python -m benchmarks.trials

# CASES=5000 SEED=0: what is tried, and from which seed on.
monkey: $(STAMP)
	$(BIN)/python -m tests.monkey --cases $(or $(CASES),5000) --first-seed $(or $(SEED),0)

clean:
	rm -rf $(VENV) demo-out

$(STAMP): pyproject.toml constraints.txt .ci/make-venv
	PYTHON="$(PYTHON)" .ci/make-venv "$(VENV)"
	touch $@
