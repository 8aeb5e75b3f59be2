PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Test processes: one per core of the CI runner.
WORKERS := 2
# Older versions of pip take the pins of build tools from the first variable, newer ones from the second.
PINNED := PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt

.PHONY: demo notebooks notebooks-docs test test-slow test-browser mutants lint figures docs clean

demo: $(STAMP)  ## search all five-module topologies for the push task
	$(BIN)/topo-search run push

notebooks: $(STAMP)  ## run every notebook with full settings, and draw the pictures of the documentation
	FULL=1 $(BIN)/jupyter-execute --timeout=-1 notebooks/*.ipynb
	$(BIN)/python tests/benchmarks/keep_results.py

notebooks-docs: $(STAMP)  ## run every notebook with small settings, and keep its outputs for the site
	KEEP=1 $(BIN)/pytest -k fresh_kernel tests/test_notebooks.py

test: lint  ## everything that CI checks, except tests in a browser
	$(BIN)/pytest -n $(WORKERS) --dist worksteal -m "not slow and not browser"
	$(MAKE) docs

test-slow: lint  ## all tests except those in a browser, slow ones included
	$(BIN)/pytest -n $(WORKERS) --dist worksteal -m "not browser"

mutants: $(STAMP)  ## put faults into a copy, and see that the tests of CI catch each
	$(BIN)/python tests/mutants/run.py

figures: $(STAMP)  ## draw the figures of the documentation from the package's data
	$(BIN)/python docs/figures.py

docs: $(STAMP)  ## build the documentation, site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet --config-file docs/mkdocs.yml

test-browser: $(STAMP)  ## test the report and the site in Chromium, which has to be installed
	$(BIN)/pytest -n $(WORKERS) --dist worksteal -m browser tests/test_docs_site.py tests/test_report_browser.py

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell
	$(BIN)/proselint check --config docs/proselint.json README.md CONTRIBUTING.md SECURITY.md CHANGELOG.md docs/pages

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("needs Python 3.11 or newer: make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(PINNED) $(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@

clean:  ## remove everything generated, except runs
	rm -rf $(VENV) site .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
