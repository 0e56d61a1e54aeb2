# Every target works on a fresh clone: it first installs packages into .venv, from requirements/run.txt
# for targets that only run rigs and from requirements/dev.txt for all others. VENV=FOLDER sets another
# folder. The packages of contrib/ use .venv-contrib, installed from requirements/contrib.txt.

PYTHON ?=
ARGS ?=
SECURE ?=
SECURELY := $(if $(filter-out 0,$(SECURE)),--secure)
VENV ?= .venv
BIN := $(VENV)/bin
export VENV
# Tests start hundreds of programs, so Python keeps its compiled files.
export PYTHONDONTWRITEBYTECODE :=
# `full`: too long for `make test`; `slow`: for `make soak` and `make contrib-full`; `engine`: needs containers.
TEST := not full and not slow and not engine
FULL := full and not slow and not engine
# Stock clients in environments of their own are slow: a budget leaves them out.
STOCK := $(if $(BUDGET_S),$(FULL),(full or slow) and not engine)
# Tests without real time run on every core, with three workers for two cores, since workers also wait
# for programs. Tests in real time run one after another, afterwards.
CORES := $(shell getconf _NPROCESSORS_ONLN)
PARALLEL := -n $(shell expr \( $(CORES) \* 3 + 1 \) / 2) --dist worksteal
OTHERS := tests/contract tests/integration tests/project tests/replay tests/unit
# The packages of contrib/ have an environment of their own. SiLA needs another protobuf in the whole
# process, so its tests run in a process of their own.
CONTRIB := .venv-contrib
ADAPTERS = $(filter-out contrib/sila/tests,$(wildcard contrib/*/tests contrib/tests))
# MADSci conflicts with the requirements of pincette.
PROJECTS := $(filter-out contrib/madsci/%,$(wildcard contrib/*/pyproject.toml))
IN_CONTRIB := $(patsubst contrib/%/pyproject.toml,%,$(PROJECTS))
TESTS := tests/system $(OTHERS)
# test files with tests in real time
TIMED = $(shell grep -lE 'stalls|real_time' $(addsuffix /test_*.py,$(filter tests/system tests/contract,$(TESTS))))
# With BUDGET_S=N no test starts later than N seconds after make; the parallel tests may use half of it.
BUDGET_S ?=
NOW_S := $(if $(BUDGET_S),$(shell date +%s))
UNTIL_HALF := $(if $(BUDGET_S),--until $(shell expr $(NOW_S) + $(BUDGET_S) / 2))
UNTIL := $(if $(BUDGET_S),--until $(shell expr $(NOW_S) + $(BUDGET_S)))
# versions of Python, each tested in an environment of its own
PYTHONS := 3.11 3.12 3.13
# pytest's exit status if ARGS select no test; one of the two sessions may have none
NO_TEST := 5
COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
  $(foreach one,pincette pincette-client $(IN_CONTRIB:%=pincette-%),--no-emit-package $(one))

SITE := $(BIN)/sphinx-build -b html -W --keep-going --quiet

.DEFAULT_GOAL := help
.PHONY: help venv dev browser demo up test test-full test-all test-one lint mutants \
  paper demo-sheet bench bench-check soak soak-load findings \
  contrib contrib-full contrib-env contrib-checked contrib-lint contrib-stock contrib-engine contrib-contained engine pins sbom wheels docs dist installed site clean

help: ## this list
	@echo "pincette: position and force control of a piezoelectric microgripper"
	@echo
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | \
	  while IFS='|' read -r target text; do printf '%-18s %s\n' "$$target" "$$text"; done
	@echo
	@echo "  PYTHON=python3.12  the Python that .venv is made with (any from 3.11 on)"
	@echo "  ARGS='-k grip'     passed on to the command"
	@echo "  SECURE=1           demo and up: over mutual TLS, with certificates made on the fly"

# filled STEP: install into .venv what a step needs.
define filled
@for python in $(or $(PYTHON),python3.11 python3.12 python3.13 python3); do \
  if "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
    exec "$$python" requirements/install.py $(1) $(if $(PYTHON),--this-python); \
  fi; \
done; \
echo "pincette needs Python 3.11 or later; tried:" \
  "$(or $(PYTHON),python3.11 python3.12 python3.13 python3)." \
  "Install one, or name it: make PYTHON=/path/to/python3.11" >&2; \
exit 1
endef

# tested MARKS COMMAND: run the parallel tests of these marks, the command, then the tests in real time.
# A session may have no test under ARGS, but not all of them. Sets $$status.
define tested
echo "== pytest, on every core: $(1)"; \
$(BIN)/pytest -m "($(1)) and not real_time" $(PARALLEL) $(UNTIL_HALF) $(ARGS) $(TESTS); parallel=$$?; \
$(2) \
echo "== pytest, in real time, one after another: $(1)"; \
$(BIN)/pytest -m "($(1)) and real_time" $(UNTIL) $(ARGS) $(TIMED); alone=$$?; \
$(call judged,$$parallel $$alone)
endef

# beside MARKS: run the tests of contrib, those of SiLA in a process of their own. Sets $$status.
define beside
echo "== pytest, contrib without SiLA: $(1)"; \
$(BIN)/pytest -m "($(1)) and not real_time" $(PARALLEL) $(UNTIL) $(ARGS) $(ADAPTERS); parallel=$$?; \
echo "== pytest, SiLA: $(1)"; \
$(BIN)/pytest -m "$(1)" $(UNTIL) $(ARGS) contrib/sila/tests; sila=$$?; \
echo "== pytest, contrib in real time: $(1)"; \
$(BIN)/pytest -m "($(1)) and real_time" $(UNTIL) $(ARGS) contrib/nidaqmx/tests; alone=$$?; \
$(call judged,$$parallel $$sila $$alone)
endef

# judged STATUSES: set $$status to that of the last session that failed. A session may have no test under
# ARGS, but not all of them.
define judged
status=$(NO_TEST); \
for one in $(1); do \
  test $$one -eq $(NO_TEST) || test $$one -eq 0 -a $$status -ne $(NO_TEST) || status=$$one; \
done; \
test $$status -ne $(NO_TEST) || echo "ARGS='$(ARGS)' leave no test" >&2
endef

venv:
	$(call filled,run)

dev:
	$(call filled,dev)

browser: dev
	@$(BIN)/python requirements/system_programs.py

demo: venv ## a simulated rig grips a bead; nothing else is needed
	@$(BIN)/pincette demo $(SECURELY) $(ARGS)

up: venv ## start a whole rig and its supervisor; Ctrl-C ends it
	@$(BIN)/pincette up $(SECURELY) $(ARGS)

# The linters run in parallel with the parallel tests; their output is printed afterwards. There are two
# workers for each core, since these tests wait more than they compute.
test: PARALLEL := -n $(shell expr $(CORES) \* 2) --dist worksteal
test: dev ## lint and a fair check of everything, in about twelve minutes on two cores
	@$(MAKE) --no-print-directory lint > $(VENV)/lint.log 2>&1 & lint=$$!; \
	$(BIN)/python requirements/system_programs.py; \
	$(call tested,$(TEST),wait $$lint; linted=$$?; cat $(VENV)/lint.log;); \
	test $$linted -eq 0 || { echo "== lint failed, exit status $$linted: see above" >&2; exit 1; }; \
	exit $$status

test-full: browser ## the tests that `make test` leaves out; BUDGET_S=1800 ends them after 30 min
	@$(call tested,$(FULL)); exit $$status

test-all: ## the tests without lint and whole rigs, with each supported Python
	@for version in $(PYTHONS); do \
	  python=$$(sh requirements/python.sh $$version) || exit 1; \
	  echo "== Python $$version: $$python"; \
	  $(MAKE) --no-print-directory test-one PYTHON="$$python" VENV=.venv-$$version || exit 1; \
	done

test-one: TESTS := $(OTHERS)
test-one: dev
	@$(call tested,not slow and not engine); exit $$status

lint: dev ## style, types and the direction of imports
	@echo "== ruff check"
	@$(BIN)/ruff check --quiet .
	@echo "== ruff format"
	@$(BIN)/ruff format --check --quiet .
	@echo "== basedpyright"
	@$(BIN)/basedpyright
	@echo "== import-linter"
	@$(BIN)/lint-imports --no-cache --no-logo

mutants: dev ## change the safety module in every small way; its unit tests must notice each
	@$(BIN)/python -m tests.mutants.run $(ARGS)

demo-sheet: dev ## measure the data sheet of the demo rig; writes docs/reference/demo-data-sheet.md
	@$(BIN)/python docs/demo_data_sheet.py

paper: venv ## repeat the paper's experiments; writes data/paper/index.html, in some minutes
	@PYTHONPATH=contrib/study $(BIN)/python -m pincette_study $(ARGS)

bench: dev ## measure loop, hops, plant, rates, many rigs; writes bench.json
	@$(BIN)/python -m tests.bench.loop $(ARGS)
	@$(BIN)/python -m tests.bench.hop
	@$(BIN)/python -m tests.bench.plant
	@$(BIN)/python -m tests.bench.realtime.rates
	@$(BIN)/python -m tests.bench.realtime.scale

bench-check: dev ## compare with the expected ratios; ARGS=--short omits measurements of time
	@$(BIN)/python -m tests.bench.check $(ARGS)

soak: dev ## the tests that take minutes or hours each; they write figures to data/figures
	@mkdir -p data/figures
	@export PINCETTE_FIGURES=$(CURDIR)/data/figures; \
	$(BIN)/pytest -m slow $(ARGS) $(if $(filter tests/%,$(ARGS)),,tests)

soak-load: dev ## 50 clients beside 30 grips, ten minutes each with 5000 and 50 000 jobs in the journal
	@mkdir -p data/figures
	@PINCETTE_FIGURES=$(CURDIR)/data/figures $(BIN)/python -m tests.support.load $(ARGS)

findings: ## run the scripts of findings/ one after another; needs the network, not part of CI
	@failed=; for script in findings/*.sh; do \
	  echo "== $$script"; bash "$$script" || failed="$$failed $$script"; \
	done; \
	test -z "$$failed" || { echo "no longer as described:$$failed" >&2; exit 1; }

contrib: ## lint and test the packages beside the core, in an environment of their own
	@$(MAKE) --no-print-directory contrib-checked VENV=$(CONTRIB)

contrib-full: ## the tests of contrib with stock clients and extras, in further environments; an hour
	@$(MAKE) --no-print-directory contrib-stock VENV=$(CONTRIB)

contrib-env:
	$(call filled,contrib)

contrib-checked: contrib-env
	@$(MAKE) --no-print-directory contrib-lint > $(VENV)/lint.log 2>&1 & lint=$$!; \
	$(call beside,$(TEST)); \
	wait $$lint; linted=$$?; cat $(VENV)/lint.log; \
	test $$linted -eq 0 || { echo "== lint failed, exit status $$linted: see above" >&2; exit 1; }; \
	exit $$status

contrib-lint:
	@echo "== basedpyright, contrib"
	@$(BIN)/basedpyright -p contrib
	@echo "== import-linter, contrib"
	@$(BIN)/lint-imports --config contrib/importlinter.toml --no-cache --no-logo

contrib-stock: contrib-env
	@$(BIN)/python requirements/system_programs.py
	@$(call beside,$(STOCK)); exit $$status

engine: dev ## the tests in containers, with a Docker engine; some minutes
	@$(BIN)/pytest -m engine $(ARGS) tests/engine

contrib-engine: ## the tests of the images of contrib, with stock clients; some minutes
	@$(MAKE) --no-print-directory contrib-contained VENV=$(CONTRIB)

contrib-contained: contrib-env
	@$(BIN)/pytest -m engine $(ARGS) contrib/tests/engine

pins: dev ## pin requirements/*.txt again; ARGS=--upgrade uses newer versions
	@$(COMPILE) --extra dev --output-file requirements/dev.txt $(ARGS) pyproject.toml
	@$(COMPILE) -c requirements/dev.txt --output-file requirements/run.txt pyproject.toml
	@$(COMPILE) -c requirements/dev.txt --group loop --output-file requirements/loop.txt
	@$(COMPILE) -c requirements/dev.txt --extra dev $(PROJECTS:%=--group %:test) --output-file requirements/contrib.txt pyproject.toml $(PROJECTS)
	@$(COMPILE) -c requirements/contrib.txt --group adapters --output-file requirements/adapters.txt
	@$(COMPILE) --no-emit-package pincette-madsci --output-file requirements/madsci.txt contrib/madsci/pyproject.toml
	@echo hatchling | $(COMPILE) -c requirements/dev.txt --output-file requirements/build.txt -
	@printf 'editables\nhatchling\nuv\n' | $(COMPILE) -c requirements/dev.txt --output-file requirements/tools.txt -
	@printf 'cyclonedds\npyzmq\n' | $(COMPILE) -c requirements/dev.txt --output-file requirements/rings.txt -
	@grep -c == requirements/*.txt

sbom: dev ## write which packages each image holds, as CycloneDX, into data/sbom
	@$(BIN)/python requirements/sbom.py data/sbom

wheels: ## download the packages of the images, for deploy/offline.yml; needs Docker
	@docker build --quiet --file deploy/Dockerfile --target fetched --output wheels .
	@ls wheels | grep -c whl

docs: dev ## generate docs/reference and deploy/openapi.json
	@$(BIN)/python docs/generate.py
	@$(BIN)/python docs/generate_cli.py
	@$(BIN)/python -m pincette_supervisor.rest.api deploy/openapi.json

dist: dev ## build wheels and sdists of core, client and adapters into data/dist
	@rm -rf data/dist
	@for one in . shared $(dir $(wildcard contrib/*/pyproject.toml)); do \
	  $(BIN)/python -m build --no-isolation --outdir data/dist $$one || exit 1; \
	done

installed: ## each wheel in an empty environment, under each Python: its main job; 20 minutes
	@$(MAKE) --no-print-directory contrib-env VENV=$(CONTRIB)
	@$(CONTRIB)/bin/pytest -m slow $(ARGS) tests/system/test_release.py contrib/tests/test_extras.py
	@$(CONTRIB)/bin/pytest $(ARGS) tests/system/test_thin_client.py

site: dev ## build the documentation site in data/site; warnings are errors
	@rm -rf data/site data/site-pages
	@$(SITE) docs data/site -d data/site-pages
	@echo "data/site/index.html"

clean: ## remove .venv, caches and measurements; records under data/ stay
	rm -rf .venv $(CONTRIB) $(PYTHONS:%=.venv-%) .pytest_cache .ruff_cache .hypothesis .import_linter_cache bench.json bench.png scale.png
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
