PYTHON ?= python3
BIN := .venv/bin
DEMO := demo
# bytecode is made of what is imported, and kept: that of all that is installed takes half of an installation
export PYTHONDONTWRITEBYTECODE :=
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal --durations 25

.PHONY: demo test test-all docs notebooks style compiled clean

demo: .venv/installed  ## a small campaign from the virtual rig, its model, its tension laws, a page of figures
	rm -rf $(DEMO)
	mkdir $(DEMO)
	$(BIN)/boltlaw rig $(DEMO)/campaign --cases 10 --strengths 1,0.8,0.6 --duration-s 3 --seed 1
	$(BIN)/boltlaw identify $(DEMO)/campaign --out $(DEMO)/results
	$(BIN)/boltlaw discover $(DEMO)/campaign --out $(DEMO)/results
	$(BIN)/boltlaw report $(DEMO)/results

# one thread a process: two processes on two cores would only wait for more
test: .venv/installed-test  ## every check: style, walls between packages, types, tests
	$(MAKE) --no-print-directory --jobs 2 --output-sync=target style compiled
	$(PYTEST)

test-all: .venv/installed-test  ## the same and every variant, every law recovered from ten campaigns of the rig
	$(MAKE) --no-print-directory --jobs 2 --output-sync=target style compiled
	$(PYTEST) --seeds 10 --every

docs: .venv/installed-docs  ## the site: docs/_build/index.html; a broken link or reference is an error
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs docs/_build
	@echo wrote docs/_build/index.html

notebooks: .venv/installed-test  ## run docs/notebooks in a kernel; they keep what they print
	$(BIN)/python -m tests.documents.notebooks --run

style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

compiled: .venv/compiled

.venv/compiled: .venv/installed-test tests/compile.py $(shell find rom discovery experiments -name '*.py')
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.compile
	touch $@

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --editable .
	touch $@

.venv/installed-test: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --editable '.[test]'
	touch $@ .venv/installed

.venv/installed-docs: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --editable '.[docs]'
	touch $@ .venv/installed

clean:
	rm -rf .venv $(DEMO) docs/_build
