# `make help` lists the targets. NAME=value words after a target are handed through to the driver.
PYTHON ?= /usr/bin/python3
OMP_NUM_THREADS ?= 1
export OMP_NUM_THREADS

SCENES := $(basename $(notdir $(wildcard edp/*.edp)))
DRIVER := $(PYTHON) -m driver

# every variable given on the command line as a quoted word, but for those that are the Makefile's own
OWN := PYTHON OMP_NUM_THREADS ARGS
quote = '$(subst ','\'',$1)'
GIVEN = $(foreach v,$(filter-out $(OWN),$(.VARIABLES)),$(if $(filter command,$(origin $v)),$(call quote,$v=$(value $v))))

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-long run table effects accuracy bench study hard saddle figures $(SCENES)

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12
	@echo "$(SCENES)" | fmt -w 88 | sed '1s/^/scenes      /; 2,$$s/^/            /'

setup:  ## install the Debian packages of apt-packages.txt that are missing
	@driver/setup.sh

demo: setup  ## set up if needed, run the model example under both loadings, draw its figures
	@$(DRIVER) model $(GIVEN)

test: setup  ## set up if needed, run the tests [ARGS="-k name"]
	@$(PYTHON) -m pytest $(ARGS)

test-long: setup  ## the tests marked slow
	@$(PYTHON) -m pytest -m slow $(ARGS)

run:  ## one scene: SCENE=name or path [SUBDOMAINS=4x2|8] [STEPS=] [ADAPT=] [NP=] [OUT=] [...]; alone: list the scenes
	@$(DRIVER) run $(GIVEN)

model:  ## the model example [LOADING=monotone|nonmonotone] [FRICTION=] [CELLS=] [...]
	@$(DRIVER) model $(GIVEN)

$(filter-out model,$(SCENES)):
	@$(DRIVER) run SCENE=$@ $(GIVEN)

table:  ## the slides' table, ours beside theirs [ROWS=1,2,3] [METHOD=default|plain] [NP=] [FRESH=yes]
	@$(DRIVER) table $(GIVEN)

effects:  ## a scene as declared and with each effect left out in turn: SCENE=bracket [NP=] [...]
	@$(DRIVER) effects $(GIVEN)

bench:  ## what runs cost, beside the slides, a factorization, GetFEM, TAO and the machine's limits [PARTS=products,tao] [LARGE=yes]
	@$(DRIVER) bench $(GIVEN)

study:  ## many values of one parameter on one export: SCENE=model FRICTION=0.05:1.0:100 [NP=] [...]
	@$(DRIVER) study $(GIVEN)

hard:  ## the hard cases, each solved and checked or refused [FAMILY=scale,contact] [CASE=name] [FAST=yes] [JOBS=]
	@$(DRIVER) hard $(GIVEN)

accuracy:  ## what accuracy costs in seconds: SCENE=hertz [EFFORT=quick|full] [REPEATS=] [QUANTITY=] [...]; PART=locking|stopping
	@$(DRIVER) accuracy $(GIVEN)

saddle:  ## write and draw the FETI-DP saddle-point matrix of a small case [SCENE=] [SUBDOMAINS=] [CELLS=] [OUT=]
	@$(DRIVER) saddle $(GIVEN)

figures:  ## redraw the figures of finished runs from their files [OUT=results/mine]
	@$(DRIVER) figures $(or $(OUT),$(sort $(patsubst %/summary.json,%,$(wildcard results/*/summary.json))))
