# A new user needs only `make demo` or `make test`, which first set everything up.
.PHONY: help setup demo test test-real-time test-slow test-sample test-all test-lowest soak fuzz docs mutants check lint format lock clean
.DEFAULT_GOAL := help

BIN := .venv/bin

# .venv contains its own ROS 2. These variables would mix it with a ROS installation that is sourced in this shell. The
# last variable means that a parent Python process has found the libraries of its own .venv; this .venv must search
# again.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH PYTHONHOME \
  _ROS_WHEELS_BOOTSTRAP_COMPLETE

# Tests start many processes, and each of them would compile everything again.
unexport PYTHONDONTWRITEBYTECODE

CYCLES ?= 10000
FILES ?= 20000
STREAMS ?= 500000

# Three files run at the same time on two cores, because these tests mostly wait. At most two of the files run in real
# time (tests/distribution.py), because three stacks would delay each other's cycles on a slow machine.
PYTEST := $(BIN)/python -m pytest -rR -n 3 --dist loadfile --no-loadscope-reorder

help:
	@echo 'make setup   install everything into .venv; a repeated run takes seconds'
	@echo 'make demo    set-up, then pick and place (DEMO_ARGS="--grades A")'
	@echo 'make test    set-up, then the quick tests in simulated time (PYTEST_ARGS="-k hash")'
	@echo 'make test-real-time  the quick tests of whole programs, over ROS and pseudo-terminals'
	@echo 'make test-sample  a slow test of each folder'
	@echo 'make test-all  all tests, before a release; make test-slow: only the slow tests'
	@echo 'make test-lowest  the fast tests of the core, with the lowest versions that pyproject.toml allows'
	@echo 'make soak    the random tests over 10,000 cycles of the bus (CYCLES=3000)'
	@echo 'make fuzz    20,000 mutated files and 500,000 streams of bytes (FILES=1000 STREAMS=10000); an hour'
	@echo 'make mutants  find changes in the code that no test detects (AREAS="gate joint"); up to an hour'
	@echo 'make docs    build the documentation site from docs/ into build/site'
	@echo 'make check   set-up, then lint and all tests that CI runs'
	@echo 'make lint    lint, types and import direction only'
	@echo 'make format  format the code'
	@echo 'make lock    write requirements.lock from pyproject.toml (LOCK_ARGS=--upgrade)'
	@echo 'make clean   remove .venv and all built files'

setup:
	@sh tools/setup.sh

demo: setup
	@$(BIN)/servoloop demo $(DEMO_ARGS)

# These tests do not wait, so they use all cores.
test: setup
	$(PYTEST) -n $$(nproc) -m 'not real_time and not slow and not soak' $(PYTEST_ARGS)

test-real-time: setup
	$(PYTEST) -m 'real_time and not slow and not soak' $(PYTEST_ARGS)

# This includes the random tests, over 1,000 cycles.
test-slow: setup
	$(PYTEST) -m 'slow or soak' -o faulthandler_timeout=900 $(PYTEST_ARGS)

# CI has time for only the first slow test of each file.
test-sample: setup
	$(PYTEST) -m 'slow or soak' --sample $(PYTEST_ARGS)

test-all: test test-real-time test-slow

# The wheel is tested in a separate environment.
test-lowest: setup
	sh tools/test_lowest.sh $(PYTEST_ARGS)

soak: setup
	SERVOLOOP_FAULT_CYCLES=$(CYCLES) $(PYTEST) -m soak --timeout 600 -o faulthandler_timeout=900 $(PYTEST_ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: setup
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo 'The site is built: open build/site/index.html'

# Tests with mutated files and bytes. The same seed gives the same tests.
fuzz: setup
	SERVOLOOP_MUTATED_FILES=$(FILES) SERVOLOOP_MUTATED_STREAMS=$(STREAMS) nice -n 19 $(PYTEST) --timeout 0 \
	  -o faulthandler_timeout=0 tests/mutated $(PYTEST_ARGS)

mutants: setup
	$(BIN)/python tools/mutants.py $(AREAS)

check: lint test test-real-time test-sample

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# This target does not depend on `setup`, which would refuse the outdated lock.
lock:
	@$(BIN)/uv pip compile pyproject.toml --universal --generate-hashes --quiet \
	  --extra all \
	  --group interfaces-build --group bench --group peers --group docs --group dev \
	  --custom-compile-command 'make lock' --output-file requirements.lock $(LOCK_ARGS) > /dev/null
	@echo 'requirements.lock is up to date'

clean:
	rm -rf .venv build dist out .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
