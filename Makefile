# `make` lists the targets. Every target that needs Python makes .venv itself.
.DEFAULT_GOAL := help
.PHONY: help demo test lint types docs bench vulkan clean
SHELL := /bin/bash

BIN := .venv/bin
STAMP := .venv/.installed
DEMO_OUT ?= out/demo
PYTEST_ARGS ?= -n auto

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(STAMP): pyproject.toml constraints/ci.txt scripts/make-venv.sh
	@PYTHON='$(PYTHON)' scripts/make-venv.sh
	@touch $@

demo: $(STAMP) vulkan ## two robots meet behind a wall, in SAPIEN: video and plot
	@$(BIN)/hpp run --world wall --team fetch,freight --planner hpp --preset best --backend sapien --seed 0 --out $(DEMO_OUT)

test: $(STAMP) ## run the tests, one process per core (other options: make test PYTEST_ARGS="-x -k lidar")
	@$(BIN)/python -m pytest tests $(PYTEST_ARGS)

lint: $(STAMP) ## style, formatting and the direction of dependencies
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/lint-imports

types: $(STAMP) ## static types
	@$(BIN)/basedpyright

docs: $(STAMP) ## this documentation as web pages: build/docs/index.html
	@$(BIN)/python -m sphinx -q -E -W --keep-going -b html docs build/docs
	@echo "build/docs/index.html"

bench: $(STAMP) ## speed of everything on this machine (more options: make bench BENCH_ARGS="planning --scale full")
	@$(BIN)/hpp bench $(BENCH_ARGS)

vulkan: ## a software renderer for SAPIEN where there is none (Debian, Ubuntu; root)
	@scripts/install-vulkan.sh || echo "No Vulkan: SAPIEN simulates, but pictures come from the top-down view."

clean: ## remove the environment, caches and results of the demo
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis .import_linter_cache dist build out/demo
