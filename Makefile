# What a newcomer types. Everything runs inside .venv, which is made on first use and remade when the pins change.

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow check docs clean

BIN := .venv/bin
DEMO := out/demo

# Pip also holds itself to the pins while it builds the package. A relative path: this variable may not hold spaces.
export PIP_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Python keeps what it compiles, whatever the shell says: the tests start hundreds of processes that read the same modules.
export PYTHONDONTWRITEBYTECODE :=

# Two processes share the tests, and most machines have two cores: threads of BLAS and OpenMP would wait for each other,
# spinning. Finding a small cave's currents takes 2.0 s of processor time so, and 4.7 s with two threads.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
# The test that a process dies of, or that takes over 25 minutes, is named at once. Where pytest-xdist starts another
# process for a dead one, sharing by files, the run never ends (of version 3.8: empty files are handed out at its end).
SHARED_OUT := --numprocesses 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0 \
	-o faulthandler_timeout=1500 -o faulthandler_exit_on_timeout=true

help: ## Say what make can do here
	@echo "aquanav: real caves as navigation benchmarks for underwater vehicles."
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1#\2/p' Makefile | awk -F'#' '{ printf "%-17s%s\n", $$1, $$2 }'
	@echo "The first of these installs everything into .venv: 3 to 5 minutes and about 4 GB of disk."

demo: .venv/installed ## Photograph a synthetic cave, rebuild it from the photos, dive in it (minutes)
	@echo "1/3  Rendering photos of a synthetic cave into $(DEMO)/photos."
	@$(BIN)/aquanav render --out $(DEMO)/photos
	@echo "2/3  Building a scenario from these photos in $(DEMO)/cave."
	@$(BIN)/aquanav-build-cave $(DEMO)/photos -o $(DEMO)/cave --positions $(DEMO)/photos/positions.csv \
		--overwrite
	@echo "3/3  Diving 20 episodes in it with the hand-written controller; results go to $(DEMO)/eval."
	@$(BIN)/aquanav-eval baseline:reactive --scenario $(DEMO)/cave --episodes 20 --seed 0 -o $(DEMO)/eval
	@echo "Done. Look at:"
	@echo "  the cave's picture      $(DEMO)/cave/cave.png"
	@echo "  the cave's report       $(DEMO)/cave/report.html"
	@echo "  the dives' report       $(DEMO)/eval/report.html"
	@echo "  a dive, as recorded     $(BIN)/rerun $(DEMO)/eval/episode-00000.rrd"

test: .venv/installed ## Run the default tests (15 minutes on two cores the first time, when all compiles)
	@echo "Running the default tests; the slow ones are left out (run them with: $(BIN)/pytest -m slow)."
	@$(ONE_THREAD) $(BIN)/pytest $(SHARED_OUT)

test-slow: .venv/installed ## Run the slow tests that .ci/run runs (under 30 minutes on two cores)
	@echo "Running the slow tests; the nightly ones are left out (run them with: $(BIN)/pytest -m nightly)."
	@$(ONE_THREAD) $(BIN)/pytest $(SHARED_OUT) -m 'slow and not nightly'

check: .venv/installed ## Check style (ruff) and types (mypy)
	@echo "Checking style and types."
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

docs: .venv/installed ## Build the documentation site into site/, warnings being errors (half a minute; Python 3.11 or newer)
	@echo "Building the site; its first page is site/index.html."
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

clean: ## Delete what make made: .venv, out, build, dist, site and caches
	@echo "Deleting .venv, out, build, dist, site and caches."
	@rm -rf .venv out build dist site .pytest_cache .mypy_cache .ruff_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/installed: pyproject.toml constraints.txt
	@.ci/make-venv
	@echo "Installing aquanav and its libraries into .venv: 3 to 5 minutes, about 4 GB. Quiet unless something fails."
	@$(BIN)/python -m pip install --quiet --quiet --editable '.[dev]'
	@touch $@
