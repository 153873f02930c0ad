# Two commands matter: `make demo` and `make test`. Everything happens in .venv; nothing is installed elsewhere.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PACKAGES := bench drivers simulators

.PHONY: demo serve assets test setup lint types contracts pytest test-quick slow newest coverage guardian-coverage night truth faults hostile trials reliability profile benchmark benchmark-full peers system-peers npm-peers docs bundle clean

demo: $(VENV)/.core
	$(BIN)/bench run sequences/tumble_static.yaml --bench config/simulated.yaml --operator demo

# A station with the simulated bench, and its pages: prints the address and the code for the first login.
serve: $(VENV)/.station $(VENV)/.assets
	$(BIN)/bench serve

# Files of other projects that the pages use, as bench/web/assets.toml lists them.
assets: $(VENV)/.assets

# The checks beside the tests: those of types need one processor for a minute.
test: $(VENV)/.dev $(VENV)/.assets
	$(MAKE) --no-print-directory -j2 lint types contracts pytest

setup: $(VENV)/.dev

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

contracts: $(VENV)/.dev
	$(BIN)/lint-imports

pytest: $(VENV)/.dev $(VENV)/.assets
	$(BIN)/pytest -n 2 --dist worksteal -m 'not slow'

# What to run after each change: a minute or so.
test-quick: $(VENV)/.dev $(VENV)/.assets lint
	$(BIN)/pytest -q -n 2 --dist worksteal -m 'not slow and not lengthy' tests/unit tests/wire

# The other tests: truth over seeds, real stacks on loopback, whole benches. CI runs them after `make test`.
# More workers than processors: many of these wait in real time.
slow: $(VENV)/.dev $(VENV)/.assets
	$(BIN)/pytest -n 4 --dist worksteal -m slow --durations 20 $$($(BIN)/python -m tests.support.budget slow)

# Everything above is on the interpreter of .venv; this is a quick part on the newest one that is there (or: NEWEST=…).
newest:
	./.ci/newest

# Which branches no test goes through; apart from the tests, because it makes them a quarter longer.
coverage: $(VENV)/.dev $(VENV)/.assets
	$(BIN)/pytest -n 2 --cov --cov-report= --dist worksteal
	$(BIN)/coverage report --fail-under=90

# All branches of the guardian, by its unit tests alone.
guardian-coverage: $(VENV)/.dev
	$(BIN)/pytest -q --cov=bench.guardian --cov-fail-under=100 --cov-report=term-missing tests/unit/guardian

# The campaigns, whole: hours. Stopped, it goes on where it was; results by date are in build/night. The list of what is
# done, with the time that each takes, is campaigns/night.py. The scorecard goes on for MINUTES where it was stopped.
MINUTES ?= 0
SCHEDULER ?=
night: $(VENV)/.dev
	$(BIN)/python -m campaigns.night --minutes $(MINUTES) --scheduler "$(SCHEDULER)"

# Its parts. truth and faults are done by two processes, or by a cluster: make truth SCHEDULER=tls://HOST:8786
# (docs/how-to/campaigns.md). truth: results against the simulated truth on a perfect and on a full bench, then with errors planted. Forty
# seeds go at the level of records where there is that way, so that a seed takes seconds. All of it is about an hour, or
# half of that with two processors, and units that differ in kind hours; `bench campaign truth --seeds 4` tries a few.
# faults: 20,000 readings over all dialects on bad lines, each fault reported or borne, and none that makes a value wrong
# where the line has a checksum; 2,000 orders, none of them sent twice; and what asking twice gains where it has none.
# Then instruments that exchange their ports, and second masters: 2000 of each, none told what was meant for another.
# Then 10,000 acquisitions of counters on bad buses: every gap is told, and no count is wrong without a word.
# hostile: 100,000 mutated and hostile documents: each is read, or refused in our own words, within 100 ms.
# trials: record, safe state, locks and control, in one table; `python -m campaigns.trials --scale 0.05` is a sample.
# reliability: the scorecard, trials by the hundred; without MINUTES the table as it is.
# No part of a night, because it needs root and mutmut: `python -m campaigns.mutants --minutes 60`, which tries the tests.
truth faults hostile trials reliability: $(VENV)/.dev
	$(BIN)/python -m campaigns.night $@ --minutes $(MINUTES) --scheduler "$(SCHEDULER)"

# Where the time of a simulated bench second goes, and our decoder beside cantools.
profile: $(VENV)/.dev
	$(BIN)/python -m benchmarks.profile_run

# This program beside its peers, which get environments of their own in build/peers: parts of nights, 20 minutes. Those of
# queues need redis-server. benchmark-full: whole nights, hours; stopped, it goes on where it was.
benchmark: $(VENV)/.dev
	$(BIN)/python -m benchmarks

benchmark-full: $(VENV)/.dev
	$(BIN)/python -m benchmarks --whole

# Programs that other people wrote, for the tests that let them talk to ours.
peers: system-peers npm-peers $(VENV)/.docs
	$(BIN)/pip install --quiet --no-deps 'qcodes==0.58.*'  # with all that its drivers can do without, ten times as large
	$(BIN)/pip install --quiet --no-deps 'dvg-devices==1.8.*' 'dvg-debug-functions==2.*' 'daqmon==0.1.*'  # without their windows

system-peers:
	./.ci/install_peers

npm-peers: $(VENV)/.dev
	$(BIN)/pip install --quiet -e '.[peers]'  # node among them
	for each in azurite@3 s3rver@3; do \
	  PATH="$(abspath $(BIN)):$$PATH" npm install --silent --no-audit --no-fund --no-package-lock \
	    --prefix "build/npm/$${each%@*}" "$$each" || exit 1; \
	done

# All pages as a site with a search, in build/docs; a broken link, picture or table of contents is an error.
docs: $(VENV)/.docs
	$(BIN)/sphinx-build -q -W --keep-going -j 2 -c docs -d build/doctrees . build/docs

# One archive with all that a computer without a network needs, for this Python and this kind of machine.
bundle: $(VENV)/.made
	packaging/bundle $(BIN)/python build

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; give one with: make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' || \
	  { echo "Python's ensurepip is missing; on Debian: sudo apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.core: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet -e '.[pdf]'
	$(BIN)/python -m compileall -q $(PACKAGES)
	touch $@

$(VENV)/.station: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet -e '.[pdf,station]'
	$(BIN)/python -m compileall -q $(PACKAGES)
	touch $@ $(VENV)/.core

$(VENV)/.assets: $(VENV)/.made bench/web/assets.toml bench/web/assets.py bench/web/codemirror.js
	$(BIN)/python bench/web/assets.py
	touch $@

$(VENV)/.dev: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet -e '.[dev]'
	$(BIN)/python -m compileall -q $(PACKAGES)
	touch $@ $(VENV)/.core $(VENV)/.station

$(VENV)/.docs: $(VENV)/.dev pyproject.toml
	$(BIN)/pip install --quiet -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) .venv-newest build dist bench/web/static/vendor .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .coverage*
