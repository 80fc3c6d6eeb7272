# The front door: `make` lists what there is. Needs GNU make, a POSIX shell and Python >= 3.11.
# uv is the one on PATH (0.7 or newer; older ones know no pins of build tools) or else the one that uv.lock pins, fetched
# into .tools/.

EXE := $(if $(filter Windows_NT,$(OS)),.exe)
BIN := .venv/$(if $(EXE),Scripts,bin)
OWN_UV := .tools/uv$(EXE)
UV := $(or $(shell uv --version 2>/dev/null | grep -Eq '^uv (0\.([7-9]|[1-9][0-9])|[1-9])' && command -v uv),$(OWN_UV))

# Any Python on the machine that is new enough; make PYTHON=3.12 setup asks for a certain one.
PYTHON := >=3.11
PYTHONS := python3 python3.14 python3.13 python3.12 python3.11 python
# The core is compiled again when one of these changes.
CORE := $(wildcard src/tacstrip/core/*.[ch])
INSTALL := "$(UV)" pip install --quiet --reinstall-package tacstrip --python .venv --no-deps --editable .
# Options for pytest: make test ARGS="-k footprint".
ARGS :=

# What somebody else's environment sets must not reach ours.
unexport VIRTUAL_ENV PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE \
  UV_PYTHON UV_PYTHON_PREFERENCE UV_PROJECT_ENVIRONMENT UV_SYSTEM_PYTHON UV_NO_DEV UV_FROZEN
export UV_PYTHON_DOWNLOADS = never

# The lock names its index, so behind a mirror `uv sync --locked` calls the lock stale (or cannot reach its files).
# Then the same pins, under the same hashes, are installed from the mirror.
MIRROR := $(UV_DEFAULT_INDEX)$(UV_INDEX_URL)

.DEFAULT_GOAL := help
.PHONY: help setup ros2 demo test check docs reproduce bench benchmarks studies mutations pictures firmware pico clean

help: ## list these targets
	@sed -n 's/^\([a-z0-9]*\):.*## \(.*\)/\1|\2/p' Makefile | \
	while IFS='|' read -r target what; do printf 'make %-10s %s\n' "$$target" "$$what"; done

setup: .venv/.core ## make .venv with everything that uv.lock pins, and compile the core
	@:

# The extra at the pins and under the hashes of uv.lock; another version than pinned is replaced.
ros2: setup ## add what `tacstrip live --ros2` needs to .venv
	@"$(UV)" export --frozen --quiet --no-emit-project --no-default-groups --extra ros2 --output-file .venv/ros2.txt
	@"$(UV)" pip install --quiet --python .venv --require-hashes -r .venv/ros2.txt
	@$(BIN)/python -c "import cyclonedds.core"

demo: setup ## reconstruct the bundled readings into demo/
	@$(BIN)/tacstrip demo --out demo

test: setup ## run the tests, three at a time, the slow studies left out
	@$(BIN)/pytest -m "not slow and not builds" $(or $(ARGS),-n 3 --dist loadfile --no-loadscope-reorder)

docs: setup ## build the site of docs/ into docs/_build/html, with every example run; warnings are errors
	@$(BIN)/python -m sphinx --builder html --jobs 2 --quiet --fail-on-warning --keep-going --doctree-dir docs/_build/doctrees docs docs/_build/html
	@$(BIN)/python tools/docs_site/links.py docs/_build/html & links=$$!; \
	$(BIN)/python tools/docs_site/axe.py docs/_build/html; axe=$$?; wait $$links && exit $$axe
	@echo "docs/_build/html/index.html: the site"

check: setup ## lint, format and types; the core by other compilers and under sanitizers; the site
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/pytest -m builds -rs tests/core
	@$(BIN)/python tools/check_core.py
	@$(MAKE) --no-print-directory docs

reproduce: setup ## make the published results again into reproduction/
	@$(BIN)/tacstrip reproduce --out reproduction

bench: setup ## measure speeds and growth beside peers, and write docs/reference/speed.md
	@$(BIN)/python benchmarks/speed.py --out docs/reference/speed.md

benchmarks: setup ## run every benchmark in turn
	@for file in benchmarks/[a-z]*.py; do \
	  [ -f "$$file" ] || continue; \
	  echo "== $$file"; \
	  $(BIN)/python "$$file" || exit 1; \
	done

studies: setup ## run the slow studies
	@$(BIN)/pytest -m slow $(ARGS)

mutations: setup ## give every verb a thousand mutated inputs
	@$(BIN)/python -m studies.mutations 1000

pictures: setup ## draw the pictures of README and docs again
	@$(BIN)/python tools/docs_pictures.py
	@$(BIN)/python tools/wiring_diagram.py

firmware: ## build the firmware for the Arduino Uno (avr-gcc, avr-libc) and print what it takes
	@$(MAKE) --no-print-directory -C firmware

pico: ## build the firmware for the Raspberry Pi Pico (gcc-arm-none-eabi) and print what it takes
	@$(MAKE) --no-print-directory -C firmware rp2040

clean: ## remove everything that make made
	@rm -rf .venv .tools demo reproduction dist firmware/build .pytest_cache .hypothesis .mypy_cache .ruff_cache
	@rm -rf docs/_build docs/_drawn docs/examples docs/reference/python docs/reproduction/figures docs/sg_execution_times.rst
	@rm -f src/tacstrip/core/*.so src/tacstrip/core/*.dll
	@find src tests tools benchmarks -name __pycache__ -exec rm -rf {} + 2>/dev/null || true

# Installing anew compiles the core, whatever uv has in its cache. Bytecode is compiled here, for uv leaves it to the
# first import, and an environment with PYTHONDONTWRITEBYTECODE, as containers have it, to every one.
.venv/.setup: pyproject.toml uv.lock hatch_build.py | $(filter $(OWN_UV),$(UV))
	@echo "Setting up .venv"
ifeq ($(MIRROR),)
	@"$(UV)" sync --locked --quiet --compile-bytecode --reinstall-package tacstrip --python "$(PYTHON)" || { \
	  echo "If packages reach this machine only through a mirror, set UV_DEFAULT_INDEX to it and run make again." >&2; \
	  exit 1; \
	}
else
	@"$(UV)" venv --quiet --allow-existing --python "$(PYTHON)" .venv
	@"$(UV)" export --frozen --quiet --no-emit-project --output-file .venv/pins.txt
	@"$(UV)" pip sync --quiet --compile-bytecode --python .venv --require-hashes .venv/pins.txt
	@$(INSTALL)
endif
	@$(BIN)/python -m compileall -q src
	@touch $@

# After a change to the C, the compiler alone; without one, the build back end brings its own. The folder is newer than
# what lies in it where a file came or went.
.venv/.core: $(CORE) src/tacstrip/core tools/build_core.py | .venv/.setup
	@$(BIN)/python tools/build_core.py || $(INSTALL)
	@$(BIN)/tacstrip --version
	@touch $@

$(OWN_UV): uv.lock
	@for python in $(PYTHONS); do \
	  if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	    exec $$python -I tools/get_uv.py; \
	  fi; \
	done; \
	echo "No Python >= 3.11 found (looked for: $(PYTHONS)). Install one and have it on PATH, then run make again." >&2; \
	exit 1
