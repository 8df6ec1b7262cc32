# The verbs: setup, demo, test, check, docs, page, bench, campaign, atlas, mutants. Each does what it depends on.

VENV ?= .venv
JOBS ?= 2
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# The first interpreter that is a Python 3.11; `make PYTHON=/path/to/python3.11` overrides it.
version_of = $(shell "$(1)" -c 'import sys; print(*sys.version_info[:2], sep=".")' 2>/dev/null)
PYTHON ?= $(firstword $(foreach p,python3.11 python3 python,$(if $(filter 3.11,$(call version_of,$(p))),$(p))) python3.11)
WRONG_PYTHON = picktree needs Python 3.11; '$(PYTHON)' is $(or $(patsubst %,Python %,$(call version_of,$(PYTHON))),missing or no Python) (name another: make PYTHON=/path/to/python3.11)

.PHONY: setup demo test check docs page pictures bench campaign atlas mutants clean

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	$(if $(filter 3.11,$(call version_of,$(PYTHON))),,$(error $(WRONG_PYTHON)))
	@echo "Installing into $(VENV): about 2.8 GB, one to three minutes."
	@"$(PYTHON)" -m venv "$(VENV)"
	@"$(BIN)/python" -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch "$@"
	@echo "Ready: $(BIN)/picktree --help"

# Exit code 1 is the run's answer "goal missed", a result and no fault of the demonstration.
demo: $(READY)
	@"$(BIN)/picktree" run examples/sort_by_colour.yaml || [ $$? -eq 1 ]

test: $(READY)
	@"$(BIN)/python" -m pytest -n $(JOBS) --durations=25

check: $(READY)
	@failed=; run() { echo "== $$*"; "$(BIN)/$$@" || failed="$$failed $$1"; }; \
	run ruff check; \
	run ruff format --check; \
	run pyright --pythonpath "$(BIN)/python"; \
	run lint-imports --no-logo --no-cache; \
	[ -z "$$failed" ] || { echo "failed:$$failed" >&2; exit 1; }

# What is written from the declarations in the code; tests say when it is out of date.
docs: $(READY)
	@set -e; for kind in mission scene robot faults cases plan; do \
		"$(BIN)/picktree" schema $$kind --shipped --output schemas/$$kind.json; done; \
	"$(BIN)/picktree" nodes --shipped --markdown --output docs/nodes.md; \
	"$(BIN)/picktree" explain-code --index > docs/codes.md; \
	"$(BIN)/picktree" render examples/sort_by_colour.yaml -o docs/tree.svg

# The scripts and the style of a report, from logs/report/page/src; a test says when they are out of date.
page:
	@cd tests/logs/node && { [ -d node_modules/esbuild ] || npm ci --no-audit --no-fund; } && npm run --silent build

# The pictures of docs/report.md and docs/batches.md, taken in headless Chromium of a run with planted faults
# and of a batch that is run for it: about seven minutes of CPU.
pictures: $(READY)
	@"$(BIN)/python" -m tests.logs.report_pictures docs
	@"$(BIN)/python" -m tests.batch.report_pictures docs

bench: $(READY)
	@set -e; for program in benchmarks/*.py; do \
		case "$$program" in benchmarks/_*|benchmarks/failure_atlas.py|benchmarks/mutants.py|'benchmarks/*.py') continue;; esac; \
		echo "== $$program"; "$(BIN)/python" "$$program"; done

# Each kind of fault on 20 seeds, with recovery and without, as a batch that goes on where it stopped; the table.
# It says first what it costs. Exit code 1 is the campaign's answer "a target is missed".
campaign: $(READY)
	@"$(BIN)/python" benchmarks/fault_campaign.py --markdown docs/fault-campaign.md || [ $$? -eq 1 ]

# The worst ten runs of that campaign with pictures.
atlas: $(READY)
	@"$(BIN)/python" benchmarks/failure_atlas.py

# Whether the tests notice small mistakes in the code that decides: 300 mutants, about half an hour. Exit code 1:
# less than 90 % were noticed.
mutants: $(READY)
	@"$(BIN)/python" benchmarks/mutants.py

clean:
	rm -rf "$(VENV)" build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .mutants
