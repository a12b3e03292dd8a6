# make setup   environment in .venv, with the `asdfviz` command
# make app     setup, then the app on the bundled sample (ARGS="--port 8123" passes arguments on)
# make test    setup, then format, lint, types and tests
PYTHON ?= python3
BIN := .venv/bin
ARGS ?=
# One process more than there are cores, four at most: tests often wait for browsers and programs.
WORKERS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN); echo $$((n < 4 ? n + 1 : 4)))
# Many tests start programs of their own, which load faster where bytecode is kept.
test: export PYTHONDONTWRITEBYTECODE =

.PHONY: setup app test types tests format clean
.DELETE_ON_ERROR:

setup: .venv/app.stamp

.venv/bin/python:
	@bash .ci/system_packages python3-venv libegl1 libgl1-mesa-dri
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "asdfviz needs Python 3.11 or newer; name one: make PYTHON=python3.12 setup"; exit 1; }
	$(PYTHON) -m venv .venv

.venv/app.stamp: pyproject.toml constraints.txt | .venv/bin/python
	@bash .ci/system_packages libegl1 libgl1-mesa-dri
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	@touch $@

.venv/test.stamp: .venv/app.stamp
	@bash .ci/system_packages chromium
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev]"
	@touch $@

app: setup
	@$(BIN)/python app.py $(ARGS)

test: .venv/test.stamp
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@# Types beside tests, which wait for browsers and processes now and then.
	$(MAKE) --no-print-directory -j2 types tests

types:
	@$(BIN)/pyright > .venv/types.log 2>&1; wrong=$$?; cat .venv/types.log; exit $$wrong

# These call most compiled loops, which are kept on disk; else every test process compiles them.
COMPILING := tests/methods/test_tracking_methods.py::test_asdf_track_finds_parts_again \
  tests/methods/test_asdf_plus.py::test_the_state_is_followed_and_a_hidden_part_placed \
  tests/methods/test_asdf_seg.py::test_it_runs_on_the_sample

tests:
	@$(BIN)/python -m pytest -q -n 0 $(COMPILING) > .venv/compiling.log 2>&1 || cat .venv/compiling.log
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --durations=25 $(ARGS)

format: .venv/test.stamp
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv dist build .pytest_cache .ruff_cache
