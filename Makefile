# Everything a newcomer types: `make run` and `make test`. Each makes its own environment.

ifndef PYTHON
PYTHON := $(shell for p in python3.13 python3.12 python3.11 python3; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$p"; break; }; done)
endif
VENV ?= .venv
BIN := $(VENV)/bin
SUITE ?= fig5

.PHONY: run test lint types docs gallery wheel gate check clean

run: $(VENV)/.ready
	$(BIN)/malus run $(SUITE)

# A process a core; one that has nothing left takes tests from another. For one file:
# `.venv/bin/python -m pytest tests/bench/test_plan.py -k leaving`.
test: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n logical --dist worksteal

lint: $(VENV)/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.ready-dev
	$(BIN)/mypy -p malus

# The documentation as a site, build/docs/site/index.html: strict, and without a network.
docs: $(VENV)/.ready-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --config-file reports/mkdocs.yml
	@echo build/docs/site/index.html

# Pictures of every light, body, surface, shape and room, rendered anew; some are stored in
# reports/gallery. For some of them: `make gallery SHEETS="photo rooms"`.
gallery: $(VENV)/.ready-dev
	$(BIN)/python -m malus.bench.documents.gallery build/gallery $(SHEETS)

# The built wheel, in a clean environment outside the checkout, must run a suite.
wheel: $(VENV)/.ready
	PYTHON=$(abspath $(BIN)/python) sh tests/wheel.sh

# Accuracy against the reviewed baseline: exit 1 where it got worse by more than the noise.
gate: $(VENV)/.ready
	$(BIN)/malus run gate --out build/gate
	$(BIN)/malus gate build/gate --baseline bench/baselines/gate.toml --summary build/gate.md

check: lint types test wheel gate

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "malus: expected Python 3.11 or later on the PATH, found none; install one"; exit 2; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "malus: $(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt-get install python3-venv"; exit 2; }

# Type checkers and editors read no import hook, which is how pip installs the checkout as a package:
# a file of the environment names a folder in which `malus` is a link to the checkout.
define LIST_CHECKOUT
import pathlib, sys, sysconfig
pathlib.Path(sysconfig.get_path("purelib"), "malus-checkout.pth").write_text(sys.argv[1] + chr(10))
endef
export LIST_CHECKOUT

$(VENV)/.ready: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[net]'
	mkdir -p $(VENV)/checkout
	ln -sfn $(CURDIR) $(VENV)/checkout/malus
	$(BIN)/python -c "$$LIST_CHECKOUT" $(abspath $(VENV)/checkout)
	touch $@

$(VENV)/.ready-dev: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
