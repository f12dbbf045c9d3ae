# make setup, then make demo or ./roller. See `make help`.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

export ROLLER_ROOT := $(CURDIR)
export ROLLER_NAME := make

# Processes that run tests: on two cores one more, as tests of graphs wait more than they compute.
JOBS ?= 3
# More for pytest, such as PYTEST="-k braille".
PYTEST ?=

in_workspace := source scripts/env.sh;
python := "$$ROLLER_VENV/bin/python"

.PHONY: help setup demo check test pytest soak lint format requirements clean

help: ## this list
	@grep -hE '^[a-z]+:.*##' Makefile | sed -E 's/^([a-z]+):.*## (.*)/make \1|\2/' | column -t -s '|' 2>/dev/null || grep -hE '^[a-z]+:.*##' Makefile

setup: ## install what is needed into .venv and build the packages; again only what changed
	@scripts/setup.sh

demo: setup ## roll the virtual cell over a plate and show what was measured
	@./roller demo

check: lint ## while developing: style, types, and the tests that need neither scan nor graph
	@$(in_workspace) scripts/pytest.sh -n $(JOBS) -m "not graph and not scan" $(PYTEST)

test: setup ## every check and every test
	@$(MAKE) -j2 lint pytest

pytest:
	@$(in_workspace) scripts/pytest.sh -n $(JOBS) $(PYTEST)

soak: setup ## the whole graph for MINUTES=10 while faults are injected; CALM=1 without them
	@$(in_workspace) PYTHONPATH=tests $(python) -m soak.soak --minutes $(or $(MINUTES),10) --seed $(or $(SEED),1) $(if $(CALM),--calm)

lint: setup ## style, types and the packages' dependencies
	@$(in_workspace) \
	$(python) -m ruff check .; \
	$(python) -m ruff format --check -q . || { echo "lint: run make format"; exit 1; }; \
	$(python) -m mypy; \
	"$$ROLLER_VENV/bin/lint-imports" --no-cache | tail -n 7

format: setup ## put the code into the one style
	@$(in_workspace) $(python) -m ruff check --fix -q . || true; $(python) -m ruff format -q .

requirements: setup ## pin what requirements*.in ask for; UPGRADE=1: as new as it goes
	@$(in_workspace) scripts/pin.sh

clean: ## remove what setup, builds and tests made, and nothing else
	@if [[ ! -L .venv && -d .venv/setup && ! -e .venv/setup/adopted ]]; then rm -rf .venv; \
	  elif [[ -e .venv || -L .venv ]]; then echo "clean: .venv is not of our making: left"; fi
	@for folder in build install log; do \
	  if [[ ! -L $$folder && -e $$folder/COLCON_IGNORE ]]; then rm -rf $$folder; fi; done
	@rm -rf log/ros log/setup .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	@find src tests scripts underlay \( -name __pycache__ -o -name '*.egg-info' \) -prune -exec rm -rf {} +
