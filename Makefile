# Each target does the whole set-up that it needs; `make demo` and `make test` work on a bare Debian 12.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SOAK_SCENARIOS ?= 2000

.PHONY: demo test lint soak bench bare show-recordings show-touch show-push clean

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

# Pushes that are made already are kept, too.
PUSH := $(BIN)/contactfusion experiment push
STRATEGIES := tuned paper paper_neither paper_lateral_only paper_realign_only \
	tuned_neither tuned_lateral_only tuned_realign_only dipole_field inverse_model
RANDOM := --controller tuned --starts random --seed 500

show-push: $(READY)
	$(PUSH) $(addprefix --controller ,$(STRATEGIES)) --targets grid \
		--record box-mu1-grid-000 --record cylinder-mu1-grid-000 --out out/push/grid
	$(PUSH) $(RANDOM) --targets random:500 --out out/push/random
	$(PUSH) $(RANDOM) --targets random:150 --objects lshape,prism,light_cylinder \
		--out out/push/others
	for taxels in 24 48; do \
		$(PUSH) --controller tuned --controller paper --targets grid --taxels $$taxels \
			--out out/push/taxels_$$taxels || exit 1; \
	done
	for activation in 0 0.25 0.5 1 2; do \
		$(PUSH) $(RANDOM) --targets random:50 --objects light_cylinder \
			--activation $$activation --out out/push/activation_$$activation || exit 1; \
	done

bare:
	sh scripts/bare.sh

$(READY): pyproject.toml constraints.txt scripts/setup.sh
	sh scripts/setup.sh $(PYTHON) $(VENV)
	touch $(READY)

clean:
	rm -rf $(VENV) build out *.egg-info
