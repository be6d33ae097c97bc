# Each target does the whole set-up that it needs; `make demo` and `make test` work on a bare Debian 12.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SOAK_SCENARIOS ?= 2000

.PHONY: demo test lint soak bench bare show-recordings show-touch clean

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
	$(BIN)/contactfusion experiment recordings --rule posterior/modes --out out/recordings_posterior

# Touches that are made already are kept, so it goes on where it was stopped.
TOUCH := $(BIN)/contactfusion experiment touch --seed 2014
FURTHER := examples/objects/mug.urdf,examples/objects/bracket.urdf
FAULTS := stuck_taxel hand_eye dead_wrench silent_wrench

show-touch: $(READY)
	for noise in prototype full; do \
		$(TOUCH) --noise $$noise --spreads 0.5 --spreads 2 --out out/touch/$$noise && \
		$(TOUCH) --noise $$noise --objects $(FURTHER) --repeats 8 --out out/touch/objects_$$noise \
			|| exit 1; \
	done
	for fault in $(FAULTS); do \
		$(TOUCH) --rule de_morgan --rule posterior/modes \
			--faults examples/faults/$$fault.yaml --out out/touch/$$fault || exit 1; \
	done

bare:
	sh scripts/bare.sh

$(READY): pyproject.toml constraints.txt scripts/setup.sh
	sh scripts/setup.sh $(PYTHON) $(VENV)
	touch $(READY)

clean:
	rm -rf $(VENV) build out *.egg-info
