# `make demo` and `make test` work on a bare machine: each makes the virtual environment that it needs.
#   PYTHON  the interpreter to make it with, 3.11 or later
#   VENV    where it goes

PYTHON ?= python3
VENV ?= .venv
PIP = $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check

.PHONY: demo test test-fast studies lint docs clean

demo: $(VENV)/.installed
	$(VENV)/bin/twin demo

test: $(VENV)/.installed-dev
	$(VENV)/bin/python -m pytest -n 2

# Without the tests marked slow.
test-fast: $(VENV)/.installed-dev
	$(VENV)/bin/python -m pytest -n 2 -m "not slow and not study"

# Whole searches and fits whose kind `make test` covers by another one.
studies: $(VENV)/.installed-dev
	$(VENV)/bin/python -m pytest -n 2 -m study

lint: $(VENV)/.installed-dev
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

# The documentation site, in build/site; any warning is an error.
docs: $(VENV)/.installed-docs
	$(VENV)/bin/python docs/tools/build.py

clean:
	rm -rf $(VENV) build .hypothesis .mypy_cache .pytest_cache .ruff_cache *.egg-info
	find twin tests benchmarks -name __pycache__ -exec rm -rf {} +

# The stamps: installed again only where pyproject.toml has changed since.
$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	touch $@

$(VENV)/.installed-dev: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[dev]'
	touch $(VENV)/.installed $@

$(VENV)/.installed-docs: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[docs]'
	touch $(VENV)/.installed $@
