# Two commands that need nothing but python3 (3.11 or newer) with venv, make and a package index:
#   make demo    make test
# Another interpreter: make test PYTHON=python3.13 VENV=.venv-3.13
.DEFAULT_GOAL := help
.NOTPARALLEL:

PYTHON ?= python3
VENV ?= .venv
JOBS ?= 2
DEMO_CSV := data/green_paint_simulated/green_paint_simulated.csv
DEMO_ARGS ?=
PYTEST_ARGS ?=
ENV_PYTHON := $(VENV)/bin/python

# Threads come from ensembles and from pytest's workers; libraries that add their own only contend.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1

# An interpreter named on the command line or in the environment wins over that of a .venv that is
# there already; the default does not.
ifeq ($(origin PYTHON),file)
  CHOSEN :=
else
  CHOSEN := yes
endif

CHECK_VERSION = import sys; v = sys.version_info[:2]; (3, 11) <= v < (3, 15) or \
  sys.exit("Python %d.%d at %s: needs 3.11 to 3.14" % (*v, sys.executable)); print(v)

# $(call environment,EXTRA): makes the environment with [EXTRA], or does nothing where its stamp
# says that this very pyproject.toml is installed and the package can be imported. A .venv that was
# left half made, moved, damaged or robbed of its interpreter is made anew.
define environment
	@set -e; \
	here=$$("$(PYTHON)" -c '$(CHECK_VERSION)') || { \
	  echo "make: no usable '$(PYTHON)'. Install Python 3.11 or newer, or name one: make $@ PYTHON=python3.12" >&2; exit 1; }; \
	want="$$(cksum < pyproject.toml) $$(pwd)"; stamp="$(VENV)/.installed-$(or $(1),plain)"; \
	there=$$("$(ENV_PYTHON)" -c '$(CHECK_VERSION)' 2>/dev/null) || there=; \
	if [ -n "$(CHOSEN)" ] && [ "$$there" != "$$here" ]; then there=; fi; \
	imports() { "$(ENV_PYTHON)" -c 'import pbrdf_bayes, numpy, numba, scipy' 2>/dev/null; }; \
	create() { \
	  echo "making $(VENV) with $$("$(PYTHON)" --version)" >&2; \
	  "$(PYTHON)" -m venv --clear "$(VENV)" || { \
	    echo "make: '$(PYTHON) -m venv' failed; on Debian and Ubuntu install python3-venv" >&2; exit 1; }; }; \
	install() { \
	  echo "installing pbrdf-bayes$(if $(1),[$(1)]) into $(VENV)" >&2; \
	  "$(ENV_PYTHON)" -m pip install --quiet --editable '.$(if $(1),[$(1)])' >&2; }; \
	if [ -n "$$there" ] && cat "$(VENV)"/.installed-$(or $(1),*) 2>/dev/null | grep -qxF "$$want" \
	  && imports; then exit 0; fi; \
	if [ -z "$$there" ] || ! "$(ENV_PYTHON)" -m pip --version >/dev/null 2>&1; then create; fi; \
	install; \
	if ! imports; then create; install; fi; \
	printf '%s\n' "$$want" > "$$stamp"
endef

.PHONY: help demo test test-slow validate lint format clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile

demo: ## fit the example paint; the path of its report is the last line
	$(call environment,)
	@folder=$$("$(ENV_PYTHON)" -m pbrdf_bayes fit "$(DEMO_CSV)" $(DEMO_ARGS)) && code=0 || code=$$?; \
	if [ -n "$$folder" ]; then echo "$$folder/report.html"; fi; exit $$code

test: ## the suite
	$(call environment,test)
	@"$(ENV_PYTHON)" -m pytest -n $(JOBS) --dist loadfile -m "not slow" $(PYTEST_ARGS)

test-slow: ## what takes long: small studies, stored pages, notebooks, large inputs
	$(call environment,test)
	@"$(ENV_PYTHON)" -m pytest -n $(JOBS) --dist loadfile -m slow $(PYTEST_ARGS)

validate: ## simulated studies of ranks, coverage and designs (an hour); writes reports/calibration and design_loop
	$(call environment,)
	@PYTHONPATH=. "$(ENV_PYTHON)" -m tools.validation
	@PYTHONPATH=. "$(ENV_PYTHON)" -m tools.validation.design_loop

lint: ## ruff, its formatter and mypy --strict, changing nothing
	$(call environment,dev)
	@"$(ENV_PYTHON)" -m ruff check .
	@"$(ENV_PYTHON)" -m ruff format --check .
	@"$(ENV_PYTHON)" -m mypy

format: ## format the code and make the corrections that ruff can make
	$(call environment,dev)
	@"$(ENV_PYTHON)" -m ruff check --fix .
	@"$(ENV_PYTHON)" -m ruff format .

clean: ## remove the environments, caches and builds; runs under reports/ stay
	rm -rf .venv .venv-* dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find pbrdf_bayes tests -name __pycache__ -prune -exec rm -rf {} +
