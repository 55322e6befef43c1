# Everything a person needs: Python 3.11 to 3.13 with venv, and make.
#
#   make demo     the paper's experiment, corrected and as published: out/demo/report.html
#   make test     the tests
#   make test-core  the tests of the package alone, without the laboratory: what one runs while working
#   make golden   accept the generated C as it is now; a test shows the difference before
#   make check    format, lint, types, layers, spelling, and the tests
#   make docs     the documentation as pages: out/docs/index.html
#   make bench    times of the compiled functions, against their rivals
#   make attack   hostile cases and faults, about an hour: docs/robustness.md
#   make pages    the documentation's pages that the program writes, made anew; with LOG=log16.csv.gz
#                 also that of the learners, for which dynamax and rebayes-mini should be there
#
# The first call makes .venv from requirements.lock. PYTHON=python3.12 picks another Python.

PYTHON ?= python3
JOBS ?= 2
TESTS ?= tests
OUT ?= out
UV ?= uv
EXTRAS := ardupilot bench dev docs export film logs tune viewer

BIN := .venv/bin
# the lock holds all that is needed, so that two processes can install half of it each
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps
STAMP := .venv/installed

# every program here starts other interpreters: without bytecode each compiles the package anew
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo test test-core golden lint check docs bench attack pages lock

install: $(STAMP)

$(STAMP): requirements.lock pyproject.toml lab/pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || { \
	  echo "patagium needs Python 3.11 to 3.13, and \`$(PYTHON)\` is not one: try 'make PYTHON=python3.12 ...'." >&2; \
	  exit 1; }
	@rm -f $@
	@test -x $(BIN)/python || { echo "Making .venv with $(PYTHON)"; $(PYTHON) -m venv .venv || { \
	  rm -rf .venv; echo "$(PYTHON) has no working venv module (Debian: apt install python3-venv)." >&2; exit 1; }; }
	@echo "Installing requirements.lock into .venv (once)"
	@mkdir -p .venv/lock && awk '/^[A-Za-z0-9]/ { n++ } { print > (".venv/lock/" n % 2) }' requirements.lock
	@$(PIP) --no-compile --require-hashes -r .venv/lock/0 & $(PIP) --no-compile --require-hashes -r .venv/lock/1; \
	  second=$$?; wait $$! && exit $$second
	@$(PIP) --no-build-isolation -e . -e lab
	@touch $@

demo: $(STAMP)
	@mkdir -p $(OUT)
	@$(BIN)/patagium study reproduce --out $(OUT)/demo

test: $(STAMP)
	@$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder $(TESTS)

test-core: $(STAMP)
	@$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder tests/core

golden: $(STAMP)
	@$(BIN)/python -m pytest -q tests/core/golden --accept-golden
	@git diff --stat -- tests/core/golden

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/codespell src lab tests docs README.md CHANGELOG.md CONTRIBUTING.md

check: lint test

docs: $(STAMP)
	@$(BIN)/python -m sphinx -W --keep-going -q -b html docs $(OUT)/docs
	@echo "The documentation is in $(OUT)/docs/index.html"

bench: $(STAMP)
	@mkdir -p $(OUT)
	@$(BIN)/patagium study bench -o $(OUT)/benchmarks.md --json $(OUT)/bench.json

attack: $(STAMP)
	@$(BIN)/patagium study attack --results $(OUT)/attack.json -o docs/robustness.md $(if $(LOG),--log $(LOG))

pages: $(STAMP)
	@mkdir -p $(OUT)
	@$(BIN)/python docs/draw_architecture.py
	@$(BIN)/python -m patagium_lab.exhibits docs/gallery
	@$(BIN)/patagium study validate -o docs/validation.md
	@$(BIN)/patagium study bench -o docs/benchmarks.md --json $(OUT)/bench.json
	@$(BIN)/patagium study reproduce --out $(OUT)/demo --full --page docs/results.md
	@$(BIN)/patagium study rig --out $(OUT)/rig --page docs/rig.md
	@$(BIN)/patagium study foreign --out $(OUT)/foreign --page docs/foreign.md $(if $(LOG),--log $(LOG))
	@$(if $(LOG),$(BIN)/patagium study bench learners -o docs/learners.md --log $(LOG), \
	  echo "docs/learners.md is left as it is: LOG=log16.csv.gz makes it anew")
	@echo "docs/robustness.md is left as it is: make attack makes it anew"
	@echo "docs/damage.md is left as it is: patagium study damage --page docs/damage.md takes an hour or more"

# Needs uv. The lock names no index: the one pip is configured with serves it.
lock:
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pip install uv, or UV=path/to/uv" >&2; exit 1; }
	$(UV) pip compile pyproject.toml $(foreach one,$(EXTRAS),--extra $(one)) --universal --python-version 3.11 \
	  --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate --no-header \
	  --output-file requirements.lock
