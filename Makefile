# `make help` lists the targets. NAME=value words after a target are handed to the driver.
PYTHON ?= /usr/bin/python3
OMP_NUM_THREADS ?= 1
export OMP_NUM_THREADS

# commands of the driver, see driver/options.py; each scene is a target too
COMMANDS := run model table effects study accuracy bench hard verify saddle docs figures report
SCENES := $(basename $(notdir $(wildcard edp/*.edp)))
DRIVER := $(PYTHON) -m driver

# every variable given on the command line as a quoted word, but for those of the Makefile itself
OWN := PYTHON OMP_NUM_THREADS ARGS SPREAD UNASKED
quote = '$(subst ','\'',$1)'
GIVEN = $(foreach v,$(filter-out $(OWN),$(.VARIABLES)),$(if $(filter command,$(origin $v)),$(call quote,$v=$(value $v))))

# tests are spread over a process a core; those of one file stay together
SPREAD := -n auto --maxprocesses 8 --dist loadfile
# what the linter does not ask of tests: fixtures act without being used, helpers explain themselves
UNASKED := missing-function-docstring,missing-class-docstring,unused-argument

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-long check mutants $(COMMANDS) $(SCENES)

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12
	@$(PYTHON) -m driver.options
	@printf '\nscenes, each a target\n'; echo "$(SCENES)" | fmt -w 76 | sed 's/^/            /'

setup:  ## install the Debian packages of apt-packages.txt that are missing, compile the modules
	@driver/setup.sh
	@$(PYTHON) -m compileall -qq driver || true  # else every process does it where Python keeps none

demo: setup  ## set up if needed, run the model example under both loadings, draw its figures
	@$(DRIVER) model $(GIVEN)

test: setup  ## set up if needed, run the tests [ARGS="-k name"]
	@$(PYTHON) -m pytest $(SPREAD) $(ARGS)

test-long: setup  ## the tests marked slow
	@$(PYTHON) -m pytest $(SPREAD) -m slow $(ARGS)

check: setup  ## the linter, and the rules of the house: imports, lengths, docstrings
	@$(PYTHON) -m pylint driver
	@$(PYTHON) -m pylint --disable=$(UNASKED) tests/*.py tests/*/*.py
	@$(PYTHON) -m pytest -q tests/test_house.py

# what it needs beyond the Debian packages goes beside its results
MUTANTS := results/mutants/packages
$(MUTANTS): tests/mutants.txt
	@$(PYTHON) -m pip install --quiet --upgrade --target $@ --requirement $<
	@touch $@

mutants: setup $(MUTANTS)  ## small changes of meaning, and the tests that notice [MODULE= COUNT= SEED=]
	@PYTHONPATH=$(MUTANTS) $(PYTHON) tests/mutants.py $(GIVEN)

$(COMMANDS):
	@$(DRIVER) $@ $(GIVEN)

$(filter-out $(COMMANDS),$(SCENES)):
	@$(DRIVER) run SCENE=$@ $(GIVEN)
