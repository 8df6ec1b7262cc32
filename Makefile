# The verbs: setup, demo, dev, packages, test, check, docs, site, page, vsix, golden, bench, mutants.
# Each does what it depends on.

VENV ?= .venv
JOBS ?= 2
BIN := $(VENV)/bin
LIBRARIES := $(VENV)/lib/python3.11/site-packages
ROOMS := $(patsubst %/__init__.py,%,$(wildcard */__init__.py))

# Stamps of the environment: it has what runs need; it has what tests and checks need, too.
RUN := $(VENV)/.ready-run
DEV := $(VENV)/.ready-dev
RUN_TAKES := 340 MB to download, 1.4 GB of disk, about a minute
DEV_TAKES := 840 MB to download, 2.9 GB of disk, about two minutes in all

# The first interpreter that is a Python 3.11; `make PYTHON=/path/to/python3.11` overrides it.
version_of = $(shell "$(1)" -c 'import sys; print(*sys.version_info[:2], sep=".")' 2>/dev/null)
PYTHON ?= $(firstword $(foreach p,python3.11 python3 python,$(if $(filter 3.11,$(call version_of,$(p))),$(p))) python3.11)
WRONG_PYTHON = picktree needs Python 3.11; '$(PYTHON)' is $(or $(patsubst %,Python %,$(call version_of,$(PYTHON))),missing or no Python) (name another: make PYTHON=/path/to/python3.11)

.PHONY: setup demo dev packages test check docs site page vsix pictures golden bench mutants clean
.NOTPARALLEL:

setup: $(RUN)

$(RUN): pyproject.toml constraints.txt
	$(call install,.,what runs need into $(VENV): $(RUN_TAKES))
	@touch "$(RUN)"
	@echo "Ready: $(BIN)/picktree --help"

dev: $(DEV)

$(DEV): pyproject.toml constraints.txt
	$(call install,.[dev],what tests and checks need into $(VENV): $(DEV_TAKES))
	@touch "$(RUN)" "$(DEV)"

# Without its interpreter an environment is none, whatever its stamps say.
ifeq ($(realpath $(BIN)/python),)
.PHONY: $(RUN) $(DEV)
endif

# No stamp stands while something is being installed, and the next call goes on where this one was killed. The last
# file of an empty environment is bin/pip. The RECORD of a library names INSTALLER once it is whole; pip does not
# look at that, so what is half installed is hidden from pip. Without build isolation an offline repetition works.
# The checkout's modules are compiled, as pip does with libraries: not every shell lets Python keep bytecode.
PIP = "$(BIN)/python" -m pip install --quiet --disable-pip-version-check -c constraints.txt
define install
	$(if $(filter 3.11,$(call version_of,$(PYTHON))),,$(error $(WRONG_PYTHON)))
	@echo "Installing $(2)."
	@rm -f "$(RUN)" "$(DEV)"
	@[ -x "$(BIN)/python" ] && [ -x "$(BIN)/pip" ] || { \
		[ ! -e "$(VENV)/pyvenv.cfg" ] || rm -rf "$(BIN)" "$(VENV)/lib" "$(VENV)"; "$(PYTHON)" -m venv "$(VENV)"; }
	@rm -rf "$(LIBRARIES)"/~*
	@for info in "$(LIBRARIES)"/*.dist-info; do grep -qs INSTALLER "$$info/RECORD" || rm -rf "$$info"; done
	@$(PIP) setuptools && $(PIP) --no-build-isolation -e '$(1)' || \
		{ echo "The installation broke off: the next make goes on with it." >&2; exit 1; }
	@"$(BIN)/python" -m compileall -q *.py $(ROOMS)
endef

# What tests compare with, and what bundles the scripts of our pages; npm writes that file last.
PACKAGES := $(patsubst %/package.json,%/node_modules/.package-lock.json,$(wildcard tests/*/node/package.json))
packages: $(PACKAGES)

tests/%/node/node_modules/.package-lock.json: tests/%/node/package-lock.json
	@command -v npm >/dev/null || { echo "npm is missing: apt-get install nodejs npm" >&2; exit 1; }
	@rm -rf "$(@D)"
	@npm ci --prefix "tests/$*/node" --no-audit --no-fund
	@touch "$@"

# Exit code 1 is the run's answer "goal missed", a result and no fault of the demonstration.
demo: $(RUN)
	@"$(BIN)/picktree" run examples/sort_by_colour.yaml || [ $$? -eq 1 ]

test: $(DEV)
	@"$(BIN)/python" -m pytest -n $(JOBS) --durations=25

# pyright makes more garbage than node expects; with more room for it, it takes a seventh less CPU time.
check: $(DEV)
	@export NODE_OPTIONS="--max-semi-space-size=64 $$NODE_OPTIONS"; failed=; run() { echo "== $$*"; "$(BIN)/$$@" || failed="$$failed $$1"; }; \
	run ruff check; \
	run ruff format --check; \
	run pyright --stats --pythonpath "$(BIN)/python"; \
	run python tests/import_contracts.py; \
	[ -z "$$failed" ] || { echo "failed:$$failed" >&2; exit 1; }

# What is written from the declarations in the code; tests say when it is out of date.
docs: $(RUN)
	@set -e; for kind in mission scene robot faults cases plan; do \
		"$(BIN)/picktree" schema $$kind --shipped --output schemas/$$kind.json; done; \
	for kind in scene robot faults cases plan; do \
		"$(BIN)/picktree" schema $$kind --markdown --output docs/reference-$$kind.md; done; \
	"$(BIN)/picktree" nodes --shipped --markdown --output docs/nodes.md; \
	"$(BIN)/picktree" nodes --shipped --stub --output apps/api/nodes.pyi; \
	"$(BIN)/picktree" explain-code --index > docs/codes.md; \
	"$(BIN)/python" docs/events_page.py > docs/events.md; \
	"$(BIN)/python" docs/doors_page.py > docs/doors.md; \
	"$(BIN)/python" docs/scenes_page.py > docs/reference-scenes.md; \
	"$(BIN)/python" docs/tables_page.py > docs/reference-tables.md; \
	"$(BIN)/python" docs/page_types.py > apps/studio/page/src/records.ts; \
	"$(BIN)/picktree" render examples/sort_by_colour.yaml -o docs/tree.svg

# The documentation with an index and search, in site/. Exit code 1 also for a link that leads nowhere.
site: $(DEV)
	@NO_MKDOCS_2_WARNING=1 "$(BIN)/python" -m mkdocs build --strict && echo "See it: $(BIN)/python -m http.server -d site"

# The scripts and styles of a report and of the studio, from src/ in analysis/report/page and apps/studio/page; tests say
# when they are out of date.
page: tests/logs/node/node_modules/.package-lock.json tests/studio/node/node_modules/.package-lock.json
	@cd tests/logs/node && npm run --silent build
	@cd tests/studio/node && npm run --silent test && npm run --silent build

# The extension for VS Code, docs/editors/vscode/picktree.vsix: `code --install-extension` takes it.
vsix:
	@command -v npm >/dev/null || { echo "npm is missing: apt-get install nodejs npm" >&2; exit 1; }
	@npm ci --prefix docs/editors/vscode --no-audit --no-fund
	@npm run --prefix docs/editors/vscode package

# The pictures of docs/report.md, docs/batches.md and docs/studio.md, taken in headless Chromium of a run with planted faults
# of a batch and of five more that are run for it: about eight minutes of CPU.
pictures: $(DEV)
	@"$(BIN)/python" -m tests.analysis.report_pictures docs
	@"$(BIN)/python" -m tests.batch.report_pictures docs
	@"$(BIN)/python" -m tests.studio.studio_pictures docs
	@"$(BIN)/python" -m tests.studio.studio_pictures docs/studio --all

# The digests of the golden runs, recorded again after a change of the simulation that is meant.
golden: $(RUN)
	@"$(BIN)/python" tests/golden/runs.py --write

# CPU time of commands and runs beside a reference, as a table. It says first what it costs. RUNS is the number of
# rounds; each program in benchmarks/ measures something else.
RUNS ?= 5
bench: $(RUN)
	@"$(BIN)/python" benchmarks/speed.py --runs $(RUNS)

# Whether the tests of a module notice small mistakes in it: COUNT mutants, each as long as the TESTS take.
MODULE ?= robot/control/soft_limits.py
TESTS ?= tests/control/test_control_boundaries.py
COUNT ?= 20
mutants: $(DEV)
	@"$(BIN)/python" -c "import cosmic_ray" 2>/dev/null || $(PIP) cosmic-ray
	@"$(BIN)/python" benchmarks/mutants.py $(MODULE) $(TESTS) --count $(COUNT)

clean:
	rm -rf "$(VENV)" build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
