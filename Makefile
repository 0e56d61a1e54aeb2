# Every target works on a fresh clone: it first fills .venv from requirements/dev.txt; VENV=FOLDER
# takes another folder.

PYTHON ?=
ARGS ?=
SECURE ?=
SECURELY := $(if $(filter-out 0,$(SECURE)),--secure)
VENV ?= .venv
BIN := $(VENV)/bin
export VENV
# Programs are started by the hundred: what Python has compiled of them is kept.
export PYTHONDONTWRITEBYTECODE :=
COMMIT := not slow and not engine
# what goes by no clock on the wall, on every core; long files are named first, and begun first
VIRTUAL := -m "$(COMMIT) and not real_time" -n logical --dist loadfile --no-loadscope-reorder
REAL := -m "$(COMMIT) and real_time"
OTHERS := tests/contract tests/integration tests/project tests/replay tests/unit
TESTS := tests/system $(OTHERS)
# those that are tested each in an environment of its own
PYTHONS := 3.11 3.12 3.13
# pytest's exit status where ARGS leave no test; one half may have none
NO_TEST := 5
COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --no-emit-index-url --no-emit-find-links

SITE := $(BIN)/sphinx-build -b html -W --keep-going --quiet

.DEFAULT_GOAL := help
.PHONY: help venv browser demo up test test-all test-one lint mutants paper bench bench-check soak engine pins sbom \
  wheels docs dist site clean

help: ## this list
	@echo "pincette: position and force control of a piezoelectric microgripper"
	@echo
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | \
	  while IFS='|' read -r target text; do printf '%-18s %s\n' "$$target" "$$text"; done
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
	@$(BIN)/pytest $(VIRTUAL) $(ARGS) $(TESTS); virtual=$$?; \
	test $$virtual -eq 0 -o $$virtual -eq $(NO_TEST) || exit $$virtual; \
	echo "== pytest, in real time: one after another"; \
	$(BIN)/pytest $(REAL) $(ARGS) $(TESTS); real=$$?; \
	test $$real -eq 0 -o $$real -eq $(NO_TEST) || exit $$real; \
	test $$virtual -eq 0 -o $$real -eq 0 || { echo "ARGS='$(ARGS)' leave no test" >&2; exit $(NO_TEST); }

test-all: ## the tests without lint and whole rigs, under each Python that is supported
	@for version in $(PYTHONS); do \
	  python=$$(sh requirements/python.sh $$version) || exit 1; \
	  echo "== Python $$version: $$python"; \
	  $(MAKE) --no-print-directory test-one PYTHON="$$python" VENV=.venv-$$version || exit 1; \
	done

test-one: venv
	@$(BIN)/pytest $(VIRTUAL) $(ARGS) $(OTHERS)
	@$(BIN)/pytest $(REAL) $(ARGS) $(OTHERS)

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

bench: venv ## measure loop, hops, plant, batches, rates, many rigs; writes bench.json
	@$(BIN)/python -m tests.bench.loop $(ARGS)
	@$(BIN)/python -m tests.bench.hop
	@$(BIN)/python -m tests.bench.plant
	@$(BIN)/python -m tests.bench.batch
	@$(BIN)/python -m tests.bench.realtime.rates
	@$(BIN)/python -m tests.bench.realtime.scale

bench-check: venv ## compare with the ratios that are expected; ARGS=--short leaves out all clocks
	@$(BIN)/python -m tests.bench.check $(ARGS)

soak: venv ## the slow tests, some of them minutes long; figures go into data/figures
	@mkdir -p data/figures
	@PINCETTE_FIGURES=$(CURDIR)/data/figures $(BIN)/pytest -m slow $(ARGS)

engine: venv ## the tests in containers, with a Docker engine; some minutes
	@$(BIN)/pytest -m engine $(ARGS) tests/engine

pins: venv ## pin requirements/*.txt anew; ARGS=--upgrade takes newer versions
	@$(BIN)/python -m pip install --quiet uv
	@$(COMPILE) --extra dev --output-file requirements/dev.txt $(ARGS) pyproject.toml
	@$(COMPILE) -c requirements/dev.txt --output-file requirements/run.txt pyproject.toml
	@$(COMPILE) -c requirements/dev.txt --group loop --output-file requirements/loop.txt
	@echo hatchling | $(COMPILE) -c requirements/dev.txt --output-file requirements/build.txt -
	@grep -c == requirements/*.txt

sbom: venv ## write which packages each image holds, as CycloneDX, into data/sbom
	@$(BIN)/python requirements/sbom.py data/sbom

wheels: ## fetch what the images are built from, for deploy/offline.yml; needs Docker
	@docker build --quiet --file deploy/Dockerfile --target fetched --output wheels .
	@ls wheels | grep -c whl

docs: venv ## write what is generated: docs/reference and deploy/openapi.json
	@$(BIN)/python docs/generate.py
	@$(BIN)/python docs/generate_cli.py
	@$(BIN)/python -m pincette_supervisor.rest.openapi deploy/openapi.json

dist: venv ## build wheel and sdist into data/dist, from what git has
	@rm -rf data/dist
	@$(BIN)/python -m build --no-isolation --outdir data/dist .

site: venv ## build the documentation site into data/site; any warning ends it
	@rm -rf data/site data/site-pages
	@$(SITE) docs data/site -d data/site-pages
	@echo "data/site/index.html"

clean: ## remove .venv, caches and measurements; records under data/ stay
	rm -rf .venv $(PYTHONS:%=.venv-%) .pytest_cache .ruff_cache .hypothesis .import_linter_cache bench.json bench.png scale.png
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
