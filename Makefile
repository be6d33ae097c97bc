# Each target does the whole set-up that it needs; `make demo` and `make test` work on a bare Debian 12.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SOAK_SCENARIOS ?= 2000

.PHONY: demo test lint soak bench bare show-recordings clean

demo: $(READY)
	$(BIN)/contactfusion demo --out out/demo

test: $(READY)
	$(BIN)/python -m pytest -q

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pyright

soak: $(READY)
	$(BIN)/python -m tests.soak --scenarios $(SOAK_SCENARIOS) --workers 2

bench: $(READY)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	$(BIN)/python -m benchmarks --out out/bench.json

show-recordings: $(READY)
	$(BIN)/contactfusion experiment recordings --out out/recordings

bare:
	sh scripts/bare.sh

$(READY): pyproject.toml constraints.txt scripts/setup.sh
	sh scripts/setup.sh $(PYTHON) $(VENV)
	touch $(READY)

clean:
	rm -rf $(VENV) build out *.egg-info
