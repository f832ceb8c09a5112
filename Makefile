# `make demo` and `make test` set everything up by themselves; see README.md.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
# What `vfoa models export` needs beside the lock, which leaves it out for its size.
TORCH  := torch==2.13.0

.PHONY: demo test explore fuzz faults test-export export-extra coverage check lint types format lock docs release-notes wheel clean

demo: $(READY)
	$(BIN)/vfoa demo

# One process per core, each with one thread for linear algebra: more threads than cores wait for each other. The tests
# of one file stay together, and so do the fixtures they share.
test: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses=auto --dist=loadfile

test-export: export-extra
	$(BIN)/python -m pytest tests/harness/stages/export

export-extra: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$(TORCH)"

# How often intervals hold the truth, and tests call equal configurations different: writes reports/coverage.md.
coverage: $(READY)
	$(BIN)/python -m harness.bench.coverage

# The properties alone, on other examples than the suite's, and twenty times as many.
explore: $(READY)
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=explore --timeout=3600

# Every parser on files that are almost right, CASES of them each, with a table of what was found; FUZZ="--only labels --seed 2" for more.
CASES  ?= 100000
fuzz: $(READY)
	$(BIN)/python -m tests.fuzz.campaign --cases $(CASES) $(FUZZ)

# Every verb that writes, under kills, a full disk, limits ..., as root where it is to mount file systems: a table.
SEED   ?= 1
faults: $(READY)
	$(BIN)/python -m tests.faults.plan --seed $(SEED) --out reports/faults.md $(FAULTS)

check: lint types docs test

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(READY)
	$(BIN)/mypy

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The lock holds exact versions for every platform and names no registry.
lock: $(READY)
	$(BIN)/python -m pip install --quiet "uv>=0.5"
	$(BIN)/uv pip compile --quiet pyproject.toml --group dev --universal --python-version 3.11 \
	    --no-header --no-annotate --output-file requirements.lock

# The site, into build/site; a warning is an error. Nothing is read from the network.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 PYTHONPATH=. $(BIN)/mkdocs build --strict --quiet

# make release-notes VERSION=0.1.0; without VERSION, what is unreleased.
release-notes:
	@$(PYTHON) scripts/release_notes.py $(VERSION)

wheel: $(READY)
	$(BIN)/python -m hatchling build --target wheel

$(READY): requirements.lock pyproject.toml system-libraries.sh
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "vfoa needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	sh system-libraries.sh $(BIN)/python
	touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache
