# lacet: `make demo` shows what it does, `make test` checks it. `make help` lists the rest.
#
# The environment is .venv beside this file: versions and hashes from requirements/, nothing else is touched.
# Another Python: make demo PYTHON=/path/to/python3.12

SHELL := /bin/sh
PY := .venv/bin/python
UV := $(PY) -m uv --quiet
INSTALL := $(UV) pip install --python $(PY) --require-hashes
COMPILE := $(UV) pip compile --universal --python-version 3.11 --generate-hashes --no-header \
	--no-emit-index-url --no-emit-find-links $(if $(UPGRADE),--upgrade,)

# Packages hide behind an environment that was moved: its scripts name the old folder. Begin again then.
ifneq ($(shell cat .venv/.where 2>/dev/null),$(CURDIR))
MOVED := moved
endif

# Bytecode is kept beside its sources, whatever the environment says: tests and demo start many processes, and each
# would spend seconds on compiling NumPy, SciPy and lacet anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help demo test lint format lock schema test-slow fuzz test-vcan benchmark first-work captures seeds coverage fewer no-loads blind fresh second-blind second-car second-car-seeds laws campaign catalogue pictures reference docs notebook clean moved

help:
	@echo 'make demo          the whole chain on committed captures, in a minute or two, once the packages are loaded'
	@echo 'make test          lint and tests'
	@echo 'make lint          ruff, import contracts, pyrefly'
	@echo 'make format        format the sources'
	@echo 'make test-slow     the studies that are too long for make test, and the property tests with new examples'
	@echo 'make fuzz          2,000 mutated inputs for every reader, decoder and driver (an hour on two cores)'
	@echo 'make test-vcan     replay and record on real SocketCAN, in a User-Mode-Linux guest'
	@echo 'make benchmark     measure decoding, log, bus and fit'
	@echo 'make first-work    docs/benchmarks/first-work.md anew: how long one waits, against commit f0e8420 (hours; goes on where it was cut off)'
	@echo 'make captures      replay_logs/ anew from the simulator'
	@echo 'make seeds         docs/benchmarks/ anew: what is proposed with nothing hidden, 20 seeds (15 minutes)'
	@echo 'make coverage      docs/benchmarks/coverage.md anew: do the intervals hold the truth, 3,000 campaigns (15 minutes)'
	@echo 'make no-loads      the table of the rig without wheel loads anew, in docs/benchmarks/fewer-instruments.md: what is hidden and named (half an hour)'
	@echo 'make fewer         the table of docs/benchmarks/fewer-instruments.md anew: rigs that measure less, assumptions wrong on purpose (hours; goes on where it was cut off)'
	@echo 'make blind         docs/benchmarks/blind.md anew: effects hidden and found, or not (hours; goes on where it was cut off)   (PROCESSES=4: four at a time, 3 GB each)'
	@echo 'make fresh         docs/benchmarks/fresh.md anew: fresh cars with up to eight effects at once (a day; goes on where it was cut off)   (ARGS="--set test")'
	@echo 'make second-car-seeds  docs/benchmarks/second-car-seeds.md anew: the paper on the car on linkages, 20 seeds (hours; goes on where it was cut off)'
	@echo 'make second-blind  docs/benchmarks/second-blind.md anew: effects hidden in the car on linkages (TRIALS, PROCESSES; five minutes a trial; goes on where it was cut off)'
	@echo 'make second-car    the tables of docs/benchmarks/second-car.md anew: fits of the car on linkages (half an hour; ARGS="--only terms")'
	@echo 'make laws          docs/benchmarks/laws.md anew: laws nobody listed, hidden and found (half an hour)   (ARGS="--set test")'
	@echo 'make campaign      docs/benchmarks/campaign.md anew: 1, 10, 100 and 1,000 runs on two workers (half an hour)'
	@echo 'make catalogue     docs/catalogue.md and its pictures anew'
	@echo 'make pictures      the pictures of docs/model.md anew, and after make demo that of README.md'
	@echo 'make reference     docs/reference/ anew from the docstrings'
	@echo 'make docs          the pages of docs/ as a site that can be searched, in build/site; a broken link is an error'
	@echo 'make notebook      docs/notebooks anew from their scripts (a few minutes)'
	@echo 'make lock          requirements/ anew from pyproject.toml   (UPGRADE=1: newest versions)'
	@echo 'make schema        generated code anew from daq/schema/lacet.proto'
	@echo 'make clean         remove the environment and what tests and demo wrote'

demo: .venv/.run
	@.venv/bin/lacet demo

# Lint runs beside the tests and is told after them.
test: .venv/.dev
	@$(MAKE) --no-print-directory lint >.venv/.lint 2>&1 & lint=$$!; failed=0; \
	$(PY) -m pytest -n auto --dist loadfile --no-loadscope-reorder $(ARGS) || failed=1; \
	if wait $$lint; then tail -n 1 .venv/.lint; else cat .venv/.lint; failed=1; fi; \
	exit $$failed

lint: .venv/.dev
	@failed=; \
	$(PY) -m ruff check . || failed="$$failed ruff-check"; \
	$(PY) -m ruff format --check . || failed="$$failed ruff-format"; \
	.venv/bin/lint-imports || failed="$$failed import-linter"; \
	.venv/bin/pyrefly check --python-interpreter-path $(PY) --summary=none || failed="$$failed pyrefly"; \
	if [ -n "$$failed" ]; then echo "lint: FAILED:$$failed"; exit 1; fi; echo 'lint: ok'

format: .venv/.dev
	@$(PY) -m ruff check --fix . ; $(PY) -m ruff format .

test-slow: .venv/.dev
	@$(PY) -m pytest -m 'slow or hypothesis' --hypothesis-profile=fresh $(ARGS)

fuzz: .venv/.dev
	@$(PY) -m pytest -n auto -m slow tests/fuzz $(ARGS)

test-vcan: .venv/.dev
	@$(PY) -m pytest -m slow tests/services/acquisition/test_vcan.py $(ARGS)

# -P: benchmarks/coverage.py is not the package of that name, which Numba looks for.
benchmark: .venv/.dev
	@for file in $(filter-out %_seeds.py %/coverage.py %/campaign.py %/forces.py %/second_car.py %/second_car_seeds.py %/fewer_instruments.py %/no_wheel_loads.py,$(wildcard benchmarks/*.py)); do echo "== $$file"; $(PY) -P "$$file" || exit 1; done
	@$(PY) -m benchmarks.workbench_draw

first-work: .venv/.dev
	@$(PY) -m benchmarks.first_work --rounds $(or $(ROUNDS),3) --write $(ARGS)

captures: .venv/.dev
	@sh replay_logs/make.sh

second-car-seeds: .venv/.dev
	@$(PY) -P benchmarks/second_car_seeds.py $(ARGS)

seeds: .venv/.dev
	@$(PY) benchmarks/null_seeds.py
	@$(PY) benchmarks/null_seeds.py --bars

fewer: .venv/.dev
	@$(PY) -m benchmarks.fewer_instruments $(ARGS)

no-loads: .venv/.dev
	@$(PY) -m benchmarks.no_wheel_loads $(ARGS)

coverage: .venv/.dev
	@$(PY) benchmarks/coverage.py

blind: .venv/.dev
	@$(PY) -m benchmarks.blind --size
	@$(PY) -m benchmarks.blind --processes $(or $(PROCESSES),2)

fresh: .venv/.dev
	@$(PY) -m benchmarks.fresh --trials $(or $(TRIALS),540) --processes $(or $(PROCESSES),2) $(ARGS)

second-blind: .venv/.dev
	@$(PY) -m benchmarks.fresh --car second --set test --trials $(or $(TRIALS),9) --processes $(or $(PROCESSES),1) $(ARGS)

second-car: .venv/.dev
	@$(PY) -P benchmarks/second_car.py --folder .second-car $(ARGS)

laws: .venv/.dev
	@$(PY) -m benchmarks.laws $(ARGS)

campaign: .venv/.dev
	@$(PY) -P benchmarks/campaign.py --folder .campaign

reference: .venv/.dev
	@$(PY) docs/reference/generate.py

catalogue: .venv/.dev
	@$(PY) -m benchmarks.catalogue_page

pictures: .venv/.dev
	@$(PY) -m benchmarks.model_page
	@test ! -d demo-out/study || $(PY) docs/images/build.py

docs: .venv/.dev
	@$(PY) -m sphinx -q -W --keep-going -b html docs build/site
	@echo 'the pages: build/site/index.html'

notebook: .venv/.dev
	@$(PY) docs/notebooks/build.py

lock: .venv/.uv
	@$(COMPILE) --group build --extra plots --extra ui --extra logs pyproject.toml -o requirements/run.txt
	@$(COMPILE) --group build --group dev --extra all -c requirements/run.txt pyproject.toml -o requirements/dev.txt
	@$(COMPILE) --group build --extra plots --extra ui --extra logs --extra campaign -c requirements/dev.txt pyproject.toml -o requirements/campaign.txt
	@$(COMPILE) requirements/schema.in -o requirements/schema.txt
	@if grep -n -i -E 'https?:|file:|index-url|find-links' requirements/*.txt; then \
		echo 'lock: an address got into the files above; see the settings of uv on this machine'; exit 1; fi

schema: .venv/.uv
	@$(UV) run --no-project --isolated --python $(PY) --with-requirements requirements/schema.txt \
		python -m grpc_tools.protoc -I . --python_out=. --pyi_out=. daq/schema/lacet.proto

clean:
	rm -rf .venv demo-out .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# The environment, in three steps: uv; what runs; what tests. A step is done again when its inputs change.

moved:

.venv/.uv: requirements/uv.txt $(MOVED)
	@PYTHON='$(PYTHON)' sh requirements/make_venv.sh
	@$(PY) -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/uv.txt
	@printf '%s\n' "$(CURDIR)" > .venv/.where
	@touch $@

.venv/.run: .venv/.uv requirements/run.txt pyproject.toml
	@echo 'installing what lacet runs on (requirements/run.txt) into .venv'
	@$(INSTALL) -r requirements/run.txt
	@$(UV) pip install --python $(PY) --no-deps --no-build-isolation --editable .
	@touch $@

.venv/.dev: .venv/.run requirements/dev.txt
	@echo 'installing what the tests need (requirements/dev.txt) into .venv'
	@$(INSTALL) -r requirements/dev.txt
	@touch $@
