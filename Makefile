# Every target works on a fresh clone: it first fills .venv from requirements/dev.txt.

PYTHON ?=
ARGS ?=
SECURE ?=
SECURELY := $(if $(filter-out 0,$(SECURE)),--secure)
BIN := .venv/bin
TEST_FLAGS := -m "not slow"
VIRTUAL := tests/project tests/unit tests/integration tests/replay
# whole programs that keep no clock
LOCKSTEP := $(patsubst %,tests/system/test_%.py,lockstep orchestrator_example page_calibrations \
  page_jobs page_rigs replay several_rigs twenty_rigs)
REAL := tests/contract tests/system
# pytest's exit status where ARGS leave no test; one half may have none
NO_TEST := 5
COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --no-emit-index-url --no-emit-find-links

.DEFAULT_GOAL := help
.PHONY: help venv browser demo up test lint mutants paper bench soak pins docs clean

help: ## this list
	@echo "pincette: position and force control of a piezoelectric microgripper"
	@echo
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1|\2/p' Makefile | \
	  while IFS='|' read -r target text; do printf '%-14s %s\n' "$$target" "$$text"; done
	@echo
	@echo "  PYTHON=python3.12  the Python that .venv is made with (any from 3.11 on)"
	@echo "  ARGS='-k grip'     passed on to the command"
	@echo "  SECURE=1           demo and up: over mutual TLS, with certificates made on the fly"

venv:
	@for python in $(or $(PYTHON),python3.11 python3.12 python3.13 python3); do \
	  if "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	    exec "$$python" requirements/install.py $(if $(PYTHON),--this-python); \
	  fi; \
	done; \
	echo "pincette needs Python 3.11 or later; tried:" \
	  "$(or $(PYTHON),python3.11 python3.12 python3.13 python3)." \
	  "Install one, or name it: make PYTHON=/path/to/python3.11" >&2; \
	exit 1

browser: venv
	@$(BIN)/python requirements/browser.py

demo: venv ## a simulated rig grips a bead; nothing else is needed
	@$(BIN)/pincette demo $(SECURELY) $(ARGS)

up: venv ## start a whole rig and its supervisor; Ctrl-C ends it
	@$(BIN)/pincette up $(SECURELY) $(ARGS)

test: lint browser ## lint, then all tests but the slow ones: what CI runs
	@echo "== pytest, what goes by no clock on the wall: on every core"
	@$(BIN)/pytest $(TEST_FLAGS) -n logical --dist loadfile $(ARGS) $(VIRTUAL) $(LOCKSTEP); virtual=$$?; \
	test $$virtual -eq 0 -o $$virtual -eq $(NO_TEST) || exit $$virtual; \
	echo "== pytest, in real time: one after another"; \
	$(BIN)/pytest $(TEST_FLAGS) $(ARGS) $(REAL) $(LOCKSTEP:%=--ignore=%); real=$$?; \
	test $$real -eq 0 -o $$real -eq $(NO_TEST) || exit $$real; \
	test $$virtual -eq 0 -o $$real -eq 0 || { echo "ARGS='$(ARGS)' leave no test" >&2; exit $(NO_TEST); }

lint: venv ## style, types and the direction of imports
	@echo "== ruff check"
	@$(BIN)/ruff check --quiet .
	@echo "== ruff format"
	@$(BIN)/ruff format --check --quiet .
	@echo "== basedpyright"
	@$(BIN)/basedpyright
	@echo "== import-linter"
	@$(BIN)/lint-imports --no-cache --no-logo

mutants: venv ## change the safety module in every small way; its unit tests must notice each
	@$(BIN)/python -m tests.mutants.run $(ARGS)

paper: venv ## repeat the paper's experiments; writes data/paper/index.html, in some minutes
	@$(BIN)/pincette paper $(ARGS)

bench: venv ## measure the loop, and a step of the plant; writes bench.json
	@$(BIN)/python -m tests.bench.loop $(ARGS)
	@$(BIN)/python -m tests.bench.plant

soak: venv ## the slow tests, some of them minutes long; figures go into data/figures
	@mkdir -p data/figures
	@PINCETTE_FIGURES=$(CURDIR)/data/figures $(BIN)/pytest -m slow $(ARGS)

pins: venv ## pin requirements/*.txt anew; ARGS=--upgrade takes newer versions
	@$(BIN)/python -m pip install --quiet uv
	@$(COMPILE) --extra dev --output-file requirements/dev.txt $(ARGS) pyproject.toml
	@$(COMPILE) -c requirements/dev.txt --output-file requirements/run.txt pyproject.toml
	@echo hatchling | $(COMPILE) -c requirements/dev.txt --output-file requirements/build.txt -
	@grep -c == requirements/dev.txt requirements/run.txt requirements/build.txt

docs: venv ## write what is generated: docs/reference and deploy/openapi.json
	@$(BIN)/python docs/generate.py
	@$(BIN)/python docs/generate_cli.py
	@$(BIN)/python -m pincette_supervisor.rest.openapi deploy/openapi.json

clean: ## remove .venv, caches and measurements; records under data/ stay
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis .import_linter_cache bench.json
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
