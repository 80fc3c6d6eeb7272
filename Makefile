# The front door: `make` lists what there is. Needs GNU make, a POSIX shell and Python >= 3.11.
# uv is the one on PATH (0.5 or newer) or else the one that uv.lock pins, fetched into .tools/.

EXE := $(if $(filter Windows_NT,$(OS)),.exe)
BIN := .venv/$(if $(EXE),Scripts,bin)
OWN_UV := .tools/uv$(EXE)
UV := $(or $(shell uv --version 2>/dev/null | grep -Eq '^uv (0\.([5-9]|[1-9][0-9])|[1-9])' && command -v uv),$(OWN_UV))

# Any Python on the machine that is new enough; make PYTHON=3.12 setup asks for a certain one.
PYTHON := >=3.11
PYTHONS := python3 python3.14 python3.13 python3.12 python3.11 python
# Options for pytest: make test ARGS="-k footprint".
ARGS :=
# Load what recovers shapes once; it says so where it has to be compiled, as for another processor.
COMPILE := $(BIN)/python -c "import tacstrip as ts; from tacstrip.stream.warm import warm_up; warm_up(ts.Sensor.load('prototype-crs-crs'))"

# What somebody else's environment sets must not reach ours.
unexport VIRTUAL_ENV PYTHONPATH PYTHONHOME \
  UV_PYTHON UV_PYTHON_PREFERENCE UV_PROJECT_ENVIRONMENT UV_SYSTEM_PYTHON UV_NO_DEV UV_FROZEN
export UV_PYTHON_DOWNLOADS = never

# The lock names its index, so behind a mirror `uv sync --locked` calls the lock stale (or cannot reach its files).
# Then the same pins, under the same hashes, are installed from the mirror.
MIRROR := $(UV_DEFAULT_INDEX)$(UV_INDEX_URL)

.DEFAULT_GOAL := help
.PHONY: help setup demo test check reproduce bench studies pictures firmware clean

help: ## list these targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/\1|\2/p' Makefile | \
	while IFS='|' read -r target what; do printf 'make %-10s %s\n' "$$target" "$$what"; done

setup: .venv/.setup ## make .venv with everything that uv.lock pins
	@:

demo: setup ## reconstruct the bundled readings into demo/
	@$(BIN)/tacstrip demo --out demo

test: setup ## run the tests, two at a time, the slow studies left out
	@$(COMPILE)
	@$(BIN)/pytest -m "not slow" $(or $(ARGS),-n 2 --dist loadfile)

check: setup ## lint, format and types
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

reproduce: setup ## make the published results again into reproduction/
	@$(BIN)/tacstrip reproduce --out reproduction

bench: setup ## run every benchmark in turn
	@for file in benchmarks/[a-z]*.py; do \
	  [ -f "$$file" ] || continue; \
	  echo "== $$file"; \
	  $(BIN)/python "$$file" || exit 1; \
	done

studies: setup ## run the slow studies
	@$(BIN)/pytest -m slow $(ARGS)

pictures: setup ## draw the pictures of README and docs again
	@$(BIN)/python tools/docs_pictures.py
	@$(BIN)/python tools/wiring_diagram.py

firmware: ## build the firmware for the Arduino Uno (avr-gcc, avr-libc) and print what it takes
	@$(MAKE) --no-print-directory -C firmware

clean: ## remove everything that make made
	@rm -rf .venv .tools demo reproduction dist firmware/build .pytest_cache .hypothesis .mypy_cache .ruff_cache
	@find src tests tools benchmarks -name __pycache__ -exec rm -rf {} + 2>/dev/null || true

.venv/.setup: pyproject.toml uv.lock | $(filter $(OWN_UV),$(UV))
	@echo "Setting up .venv"
ifeq ($(MIRROR),)
	@"$(UV)" sync --locked --quiet --python "$(PYTHON)" || { \
	  echo "If packages reach this machine only through a mirror, set UV_DEFAULT_INDEX to it and run make again." >&2; \
	  exit 1; \
	}
else
	@"$(UV)" venv --quiet --allow-existing --python "$(PYTHON)" .venv
	@"$(UV)" export --frozen --quiet --no-emit-project --output-file .venv/pins.txt
	@"$(UV)" pip sync --quiet --python .venv --require-hashes .venv/pins.txt
	@"$(UV)" pip install --quiet --python .venv --no-deps --editable .
endif
	@echo "Compiling Python's bytecode and the kernels: some 30 s"
	@$(BIN)/python -m compileall -qq -j 0 .venv src || true # some packages hold examples that are no Python
	@$(COMPILE)
	@touch $@

$(OWN_UV): uv.lock
	@for python in $(PYTHONS); do \
	  if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	    exec $$python -I tools/get_uv.py; \
	  fi; \
	done; \
	echo "No Python >= 3.11 found (looked for: $(PYTHONS)). Install one and have it on PATH, then run make again." >&2; \
	exit 1
