# make run : set up and run the main scenario        make test : set up and run the tests
# make long : what takes longest of the tests
# make golden : what the product says of twenty-three data sets, against what it said before
# make audit : unsafe code (bandit), known vulnerabilities of the requirements (pip-audit)
# make lowest : the quick tests with the lowest allowed version of every requirement
PYTHON ?= python3
BIN := .venv/bin

# two test processes on two cores (cell/threads.py)
export OPENBLAS_NUM_THREADS := 1
# the tests start many processes; compiled once
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run test long quick lowest check golden audit docs clean

run: .venv/installed
	$(BIN)/ballbar run scenarios/irb2400.yaml

test: .venv/installed check
	$(BIN)/pytest -n 2 --dist worksteal -m "not long"

long: .venv/installed
	$(BIN)/pytest -n 2 --dist worksteal -m long

quick: .venv/installed
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow and not long"

# Old libraries on today's Python warn of what is deprecated; that is no fault of ours.
lowest: .venv/installed
	$(BIN)/python -m tests.project.lowest_versions > .venv/lowest.txt
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/pip install --quiet --disable-pip-version-check -c .venv/lowest.txt -e '.[dev]'
	.venv-lowest/bin/pytest -n 2 --dist worksteal -m "not slow and not long" -W ignore::DeprecationWarning

check: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -n 2
	$(BIN)/python -m tests.project.size

golden: .venv/installed
	$(BIN)/python -m benchmarks.golden

# Tools of their own environment: what they need is no requirement of the project.
audit:
	$(PYTHON) -m venv .venv-audit
	.venv-audit/bin/pip install --quiet --disable-pip-version-check bandit pip-audit
	.venv-audit/bin/bandit -q -r cell sim acquisition ident planning ballbar --severity-level high
	.venv-audit/bin/pip-audit -r constraints.txt --no-deps --disable-pip

docs: .venv/installed
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# --no-compile takes half a minute less; what is imported is compiled then
.venv/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or later is needed: make PYTHON=/path/to/python3.11 run"; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf .venv .venv-audit .venv-lowest runs site
