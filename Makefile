# Every target sets the machine up first: system libraries, .venv, a check of both. A second set-up takes a
# moment. `make` alone lists the targets.
.DEFAULT_GOAL := help
.PHONY: help setup demo test test-slow check bench clean

help:            ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup:           ## install system libraries and .venv (once; asks for nothing)
	@bash scripts/setup.sh

demo: setup      ## mesh -> raw signals -> image, and a small dataset, into demo_out/
	.venv/bin/waveformer demo --out demo_out
	.venv/bin/waveformer generate configs/ci.toml --out demo_out/dataset

test: setup      ## the tests, a few minutes
	.venv/bin/pytest -m "not slow"

test-slow: setup ## the tests that take longer
	.venv/bin/pytest -m slow

check: setup     ## lint, format, types and tests: what must pass before a change is merged
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/pytest -m "not slow"

bench: setup     ## speed and memory, see benchmarks/
	.venv/bin/python benchmarks/run.py

clean:           ## remove caches, builds and demo_out/ (keeps .venv)
	rm -rf demo_out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
