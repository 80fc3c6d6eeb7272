# The front door: `make` lists what there is. Needs GNU make, a POSIX shell and Python >= 3.11.
# uv comes from PATH or, when it is missing, in the version of uv.lock into .tools/.

EXE := $(if $(filter Windows_NT,$(OS)),.exe)
BIN := .venv/$(if $(EXE),Scripts,bin)
OWN_UV := .tools/uv$(EXE)
UV := $(or $(shell uv --version >/dev/null 2>&1 && command -v uv),$(OWN_UV))

# Any Python on the machine that is new enough; make PYTHON=3.12 setup asks for a certain one.
PYTHON := >=3.11
PYTHONS := python3 python3.14 python3.13 python3.12 python3.11 python

# What an environment of somebody else sets must not reach ours.
unexport VIRTUAL_ENV PYTHONPATH PYTHONHOME UV_PYTHON UV_PROJECT_ENVIRONMENT UV_NO_DEV UV_FROZEN
export UV_PYTHON_DOWNLOADS = never

.DEFAULT_GOAL := help
.PHONY: help setup demo test check reproduce bench studies clean

help: ## list these targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/\1|\2/p' Makefile | \
	while IFS='|' read -r target what; do printf 'make %-10s %s\n' "$$target" "$$what"; done

setup: .venv/.setup ## make .venv with everything that uv.lock pins
	@:

demo: setup ## reconstruct the bundled readings into demo/
	@$(BIN)/tacstrip demo --out demo

test: setup ## run the tests, the slow studies left out
	@$(BIN)/pytest -m "not slow" $(ARGS)

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

clean: ## remove everything that make made
	@rm -rf .venv .tools demo reproduction dist .pytest_cache .hypothesis .mypy_cache .ruff_cache
	@find src tests tools benchmarks -name __pycache__ -exec rm -rf {} + 2>/dev/null || true

.venv/.setup: pyproject.toml uv.lock | $(filter $(OWN_UV),$(UV))
	@echo "Setting up .venv, a minute at most on a fair line"
	@"$(UV)" sync --locked --quiet --python "$(PYTHON)"
	@touch $@

$(OWN_UV): uv.lock
	@for python in $(PYTHONS); do \
	  if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	    exec $$python -I tools/get_uv.py; \
	  fi; \
	done; \
	echo "No Python >= 3.11 found (looked for: $(PYTHONS)). Install one and have it on PATH, then run make again." >&2; \
	exit 1
