# `make demo` and `make test` set everything up by themselves; see README.md.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# What running needs, and what tests, checks and documents need beside it.
READY  := $(VENV)/.ready
DEV    := $(VENV)/.ready-dev
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# What `vfoa models export` needs beside the lock, which leaves it out for its size.
TORCH  := torch==2.13.0

# Modules are compiled when they are first imported, and kept: the suite starts hundreds of processes.
unexport PYTHONDONTWRITEBYTECODE
# A shell that has sourced ROS puts its packages, pytest plug-ins among them, before those of the environment.
unexport PYTHONPATH

.PHONY: demo test test-versions explore fuzz test-export export-extra coverage check lint types format lock figures docs release-notes wheel clean

demo: $(READY)
	$(BIN)/vfoa demo

# One process per core, each with one thread for linear algebra: more threads than cores wait for each other. A worker
# gets a stretch of the suite, so that the tests of a file share their fixtures; one that is done takes half of the rest.
test: $(DEV)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses=auto --dist=worksteal

# The same under the newest versions that pyproject.toml allows, or the lowest (VERSIONS=lowest-direct), in build/.
VERSIONS ?= highest
test-versions:
	$(PYTHON) -m venv build/$(VERSIONS)
	build/$(VERSIONS)/bin/python -m pip install --quiet --disable-pip-version-check "uv>=0.5"
	VIRTUAL_ENV=build/$(VERSIONS) build/$(VERSIONS)/bin/uv pip install --quiet --resolution $(VERSIONS) --group dev --editable ".[harness]"
	sh system-libraries.sh build/$(VERSIONS)/bin/python --dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 build/$(VERSIONS)/bin/python -m pytest --numprocesses=auto --dist=worksteal $(TESTS)

test-export: export-extra
	$(BIN)/python -m pytest tests/harness/pipeline/export

export-extra: $(DEV)
	$(PIP) "$(TORCH)"

# How often intervals hold the truth, and tests call equal configurations different: writes reports/coverage.md.
coverage: $(DEV)
	$(BIN)/python -m scripts.measure coverage

# The properties alone, on other examples than the suite's, and fifty times as many.
explore: $(DEV)
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=explore --timeout=3600

# Every parser on CASES files that are almost right; make fuzz CASES=2000 SEED=2 FUZZ="-k labels". A worker that a parser ends is
# replaced, and its parser fails.
CASES  ?= 100000
SEED   ?= 1
fuzz: $(DEV)
	OMP_NUM_THREADS=1 VFOA_FUZZ_CASES=$(CASES) $(BIN)/python -m pytest tests/fuzz -k almost_right --numprocesses=auto --timeout=0 --hypothesis-seed=$(SEED) $(FUZZ)

# The checks without tests run side by side: each is one process for most of its time.
check: $(DEV)
	$(MAKE) --jobs=3 lint types docs
	$(MAKE) test

lint: $(DEV)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(DEV)
	$(BIN)/mypy
	$(BIN)/python -m scripts.worked_examples build/examples
	$(BIN)/ruff check --quiet build/examples
	$(BIN)/mypy build/examples

format: $(DEV)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# Exact versions for every platform, with hashes and without addresses: what running needs, and all that developing needs.
lock: $(DEV)
	$(PIP) "uv>=0.5"
	$(BIN)/uv pip compile $(LOCKED) --output-file requirements.lock --extra harness pyproject.toml
	$(BIN)/uv pip compile $(LOCKED) --output-file requirements-dev.lock --constraints requirements.lock --extra harness --group dev pyproject.toml

LOCKED := --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate

# Figures that documents quote from the reports, written from them.
figures: $(DEV)
	$(BIN)/python -m scripts.quoted_figures

# The site, into build/site; a warning is an error, and so is a figure that differs from its report. Nothing is read from the
# network.
docs: $(DEV)
	$(BIN)/python -m scripts.quoted_figures --check
	NO_MKDOCS_2_WARNING=1 PYTHONPATH=. $(BIN)/mkdocs build --strict # --quiet would hide the warnings from --strict
	@echo "The site: build/site/index.html. To serve it: $(BIN)/mkdocs serve"

# make release-notes VERSION=0.1.0; without VERSION, what is unreleased.
release-notes:
	@$(PYTHON) scripts/release_notes.py $(VERSION)

wheel: $(DEV)
	$(BIN)/python -m hatchling build --target wheel

# The locked Open3D needs glibc 2.35. An older system, such as RHEL 9 or Ubuntu 20.04, takes the lock without it, and then the
# newest one that it can run.
OLD_GLIBC := $(shell getconf GNU_LIBC_VERSION 2>/dev/null | awk '{ split($$2, v, "."); if (v[1] == 2 && v[2] < 35) print "yes" }')
ifeq ($(OLD_GLIBC),yes)
install_lock = awk '/^open3d/ { drop = 1 } !drop; !/\\$$/ { drop = 0 }' $(1) > $(VENV)/$(1) && $(call install,$(VENV)/$(1))
INSTALL_VFOA := $(PIP) --no-compile --editable ".[harness]"
else
install_lock = $(call install,$(1))
INSTALL_VFOA := $(PIP) --no-deps --editable .
endif
install = $(PIP) --no-compile --require-hashes --requirement $(1)

# Modules are compiled when they are first imported: to compile all of them takes longer than to install them.
$(READY): requirements.lock pyproject.toml system-libraries.sh
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "vfoa needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(call install_lock,requirements.lock)
	$(INSTALL_VFOA)
	sh system-libraries.sh $(BIN)/python
	touch $@

$(DEV): $(READY) requirements-dev.lock
	$(call install_lock,requirements-dev.lock)
	sh system-libraries.sh $(BIN)/python --dev
	touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache
