PYTHON ?= python3
BIN := .venv/bin
DEMO := demo

.PHONY: demo test clean

demo: .venv/installed  ## a small campaign from the virtual rig, its model, its tension laws, a page of figures
	rm -rf $(DEMO)
	mkdir $(DEMO)
	$(BIN)/boltlaw rig $(DEMO)/campaign --cases 12 --strengths 1,0.8,0.6 --duration-s 4 --seed 1
	$(BIN)/boltlaw identify $(DEMO)/campaign --out $(DEMO)/results
	$(BIN)/boltlaw discover $(DEMO)/campaign --out $(DEMO)/results
	$(BIN)/boltlaw report $(DEMO)/results

test: .venv/installed-test  ## every check: style, walls between packages, types, tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal  # two processes on two cores: threads of theirs would only wait

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --editable .
	touch $@

.venv/installed-test: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --editable '.[test]'
	touch $@ .venv/installed

clean:
	rm -rf .venv $(DEMO)
