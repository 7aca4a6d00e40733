# make setup | demo | test | slow | exhaustive | lint | docs | commands | bench | bench-quick | soak | mutants | licences
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST := $(BIN)/python -m pytest
OUT := out
VERSION = $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' srl/__init__.py)
# Where it is set, each of the tests' thousand processes would compile the whole project anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup demo test test-parallel test-serial slow slow-parallel slow-serial exhaustive lint docs commands bench bench-quick soak mutants licences clean
MUTANTS := approach braking position velocity torque sent samples following verified base loop units

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml $(wildcard native/*.[ch])
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "srl needs Python 3.11 or newer; set PYTHON=")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev,docs]'
	touch $@

# The main job, without hardware: a simulated hand closes and opens, the sixth finger follows.
demo: setup
	rm -rf $(OUT)/demo && mkdir -p $(OUT)/demo
	$(BIN)/srl run sixth-finger --sim --duration 12 --record $(OUT)/demo/sixth-finger.rrd --figure $(OUT)/demo/sixth-finger.png
	@echo "recording: $(OUT)/demo/sixth-finger.rrd (open it: $(BIN)/rerun $(OUT)/demo/sixth-finger.rrd)"
	@echo "picture:   $(OUT)/demo/sixth-finger.png"

# Three workers for two cores, as some tests wait; the tests of a file share fixtures that take seconds, so they stay
# together. What measures time comes after the others, one test at a time. To read all files takes a worker a quarter of
# a minute, so of the smaller sets only those are read that have such tests.
WORKERS := -n 3 --dist loadfile
SERIAL = $(shell grep -rlw --include='test_*.py' -e mark.serial tests)
SLOW = $(sort $(shell grep -rlw --include='test_*.py' -e mark.slow tests))
RUNS = tests/e2e/% tests/studies/%
EXHAUSTIVE = $(shell grep -rlwE --include='test_*.py' -e 'mark.(sampled|exhaustive)' tests)

# The serial part runs also where the parallel one has failed.
test: setup
	@$(MAKE) --no-print-directory --keep-going test-parallel test-serial

test-parallel: setup
	$(PYTEST) $(WORKERS) -m "not slow and not serial"

test-serial: setup
	$(PYTEST) -m "not slow and serial" $(SERIAL)

slow: setup
	@$(MAKE) --no-print-directory --keep-going slow-parallel slow-serial

# Files with whole runs first: a worker that began one last would be waited for.
slow-parallel: setup
	$(PYTEST) $(WORKERS) --no-loadscope-reorder -m "slow and not serial and not exhaustive" \
		$(filter $(RUNS),$(SLOW)) $(filter-out $(RUNS),$(SLOW))

slow-serial: setup
	$(PYTEST) -m "slow and serial and not exhaustive" $(SERIAL)

# A sample of single changes of the guard, the loop and units of servos: which of them no test notices. Minutes a group.
mutants: setup
	for group in $(MUTANTS); do $(BIN)/python bench/mutants.py $$group --minutes 10 --sample 30; done

# What CI doesn't run: the rest of the products of which it runs a sample, and new examples of what hypothesis tries.
exhaustive: setup
	$(PYTEST) $(WORKERS) -m "exhaustive and not serial" $(EXHAUSTIVE)
	$(PYTEST) -m "exhaustive and serial" $(EXHAUSTIVE)
	$(PYTEST) $(WORKERS) --hypothesis-profile exhaustive -m "hypothesis and not slow"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The licence of all that a user installs, with the extras; an error if one is the GPL or of its kind.
licences: setup
	$(BIN)/python -m bench.licences

# The pages as a site. A warning is an error: a dead link, a docstring that can't be read. Nothing is fetched.
docs: setup
	$(BIN)/python -m sphinx -q -W --keep-going -c docs -d $(OUT)/doctrees . $(OUT)/docs/$(VERSION)
	@echo "site: $(OUT)/docs/index.html"

# The page of all commands, made of their parsers.
commands: setup
	$(BIN)/python -m srl.runtime.cli.reference docs/commands.md

# Ten minutes on a shared two-core machine with nothing else on it; the quick set takes less than three. One that fails is
# reported, and the rest go on.
bench: setup
	$(BIN)/python -m bench

bench-quick: setup
	$(BIN)/python -m bench --quick

# An hour.
soak: setup
	$(BIN)/python -m bench.soak

clean:
	rm -rf $(VENV) $(OUT) .cache .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info runtime/_compiled.*.so
