# hystid: 'make demo' and 'make test' do everything on a fresh machine with Python 3.11, make and a C compiler.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
LINTED := hystid tests benchmarks examples fmus docs .ci

.DEFAULT_GOAL := help
.PHONY: help install demo test docs fuzz kills graph wheel lint types check concealed clean

help:            ## this list
	@grep -hE '^[a-z]+: .*##|^[a-z]+:  *##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## ?/\t/' | expand -t 14

install: $(STAMP) ## make .venv with everything in it (pinned by constraints.txt)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt torch==2.13.0
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[train,hdf5,uff,tdms,mdf,parquet,cluster,cross,test,notebook,dev]'
	@touch $@

demo: install    ## the virtual experiment end to end: Modelica to diagnosis, in ./demo
	$(BIN)/hystid demo -o demo

test: install    ## all tests
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile

concealed: install ## blind benchmark of the diagnosis on fresh cases (about an hour), writes docs/concealed-first.md
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	-$(BIN)/python examples/lab_case.py -o build/concealed/lab_case
	$(BIN)/python -m benchmarks.concealed.score --cases 153 --hard 80 --without-truth --rivals --jobs 2 -o build/concealed --doc

fuzz: install    ## hostile inputs of every kind for 25 minutes; seeds and findings in build/fuzz
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[fuzz]'
	$(BIN)/python -m benchmarks.fuzz.run --minutes 25 -o build/fuzz

kills: install   ## kill -9 at 200 random moments of commands, in build/kills
	rm -rf build/kills
	$(BIN)/python -m benchmarks.kills --kills 200 -o build/kills

docs: install    ## the documentation as a site, in build/site; catalogue and reference are made from the library itself
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/python -m docs.generate.catalogue
	$(BIN)/python -m docs.generate.reference
	$(BIN)/python -m docs.generate.imports
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

graph: install   ## who imports whom, as docs/generated/imports.svg, and lines per package
	$(BIN)/python -m docs.generate.imports

wheel: install   ## build the wheel, install it in an empty environment, and use it there
	$(BIN)/python .ci/wheel.py

lint: install    ## ruff
	$(BIN)/ruff check $(LINTED)
	$(BIN)/ruff format --check $(LINTED)

types: install   ## mypy, strict
	$(BIN)/mypy

check: lint types test wheel docs ## everything that CI runs

clean:           ## remove what was built here
	rm -rf $(VENV) demo build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
