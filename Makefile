# make demo   the main job: all systems measured on generated clips       make test   the tests
# make lint   formatter, linter, type checker, import checker             make clean  all that these made
# make pretrained   train the networks that ship, on generated clips (three quarters of an hour)
#
# make demo DATA=FOLDER measures motion matching on your own clips; SYSTEMS=mm takes all search indexes, lmm all mixtures.
#
# Each makes its own .venv first, with nothing but Python 3.11 or later; the second time that costs nothing.

DANCE := out/dancecard
DATA ?= $(DANCE)
ifeq ($(DATA),$(DANCE))
TAGS ?= $(DANCE)/tags.csv
MODELS ?= dancecard dancecard.pfnn
SYSTEMS ?= mm-exact,mm-exact-free,lmm-PSD,lmm-D,pfnn-cubic
endif
# Clips of CMU by their usual folder.
ifneq ($(filter %cmu/asfamc,$(patsubst %/,%,$(DATA))),)
# Jumps, dives, duck-unders and leaps over a box: no locomotion that a stick asks for.
EXCLUDE ?= 02_04 16_0[1-79] 127_2[1-9] 127_3*
endif
OUT ?= out/demo
VENV ?= .venv
PYTEST_FLAGS ?= -n auto --dist worksteal

BIN := $(VENV)/bin
CORE := $(VENV)/.core
DEV := $(VENV)/.dev
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --prefer-binary

.PHONY: help demo pretrained test lint format clean
.DELETE_ON_ERROR:
.NOTPARALLEL:

help:
	@sed -n 's/^# \{0,1\}//p' Makefile | head -5

demo: $(CORE)
ifeq ($(DATA),$(DANCE))
	@rm -rf "$(DANCE)"
	$(BIN)/python -m motion dancecard -o "$(DANCE)"
endif
	@test -e "$(DATA)" || { \
	  echo "error: no clips at $(DATA); say where yours are: make demo DATA=FOLDER (BVH or ASF/AMC)" >&2; exit 2; }
	$(BIN)/python -m bench compare "$(DATA)" $(if $(TAGS),--tags "$(TAGS)") $(foreach model,$(MODELS),--model "$(model)") \
	  $(if $(SYSTEMS),--systems "$(SYSTEMS)") $(foreach pattern,$(EXCLUDE),--exclude '$(pattern)') --repeats 1 --no-crowds -o "$(OUT)"

# Their fingerprints are checked by tests/test_lmm_pretrained.py.
PRETRAINED := out/pretrained
PRESET ?= quick
pretrained: $(DEV)
	$(BIN)/python -m motion dancecard -o "$(PRETRAINED)/dancecard"
	$(BIN)/python -m mm build "$(PRETRAINED)/dancecard" --tags "$(PRETRAINED)/dancecard/tags.csv" -o "$(PRETRAINED)/dancecard.mmdb"
	$(BIN)/python -m lmm train "$(PRETRAINED)/dancecard.mmdb" -o "$(PRETRAINED)/dancecard.lmm" --preset $(PRESET) --held-out 0 \
	  $(if $(wildcard $(PRETRAINED)/dancecard.lmm.checkpoint),--resume)
	$(BIN)/python -m lmm convert "$(PRETRAINED)/dancecard.lmm" -o lmm/pretrained/dancecard.lmm --weights float16 \
	  --db "$(PRETRAINED)/dancecard.mmdb"
	$(BIN)/python -m lmm train "$(PRETRAINED)/dancecard.mmdb" --model pfnn -o "$(PRETRAINED)/dancecard.pfnn" --preset $(PRESET) \
	  $(if $(wildcard $(PRETRAINED)/dancecard.pfnn.checkpoint),--resume)
	$(BIN)/python -m lmm convert "$(PRETRAINED)/dancecard.pfnn" -o lmm/pretrained/dancecard.pfnn --weights float16 \
	  --db "$(PRETRAINED)/dancecard.mmdb"

test: $(DEV)
	$(BIN)/python -m pytest $(PYTEST_FLAGS)

lint: $(DEV)
	$(BIN)/python -m ruff check .
	$(BIN)/python -m ruff format --check .
	$(BIN)/python -m mypy
	$(BIN)/lint-imports

format: $(DEV)
	$(BIN)/python -m ruff check --fix .
	$(BIN)/python -m ruff format .

clean:
	rm -rf "$(VENV)" out build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps are written last, so that an interrupted installation is taken up again.
$(BIN)/python:
	@python=; \
	for name in $(or $(PYTHON),python3.11 python3.12 python3.13 python3 python); do \
	  if "$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then python=$$name; break; fi; \
	done; \
	if [ -z "$$python" ]; then \
	  echo "error: no Python 3.11 or later at $(or $(PYTHON),python3 and its like); name one: make PYTHON=/path/to/python3" >&2; exit 2; \
	fi; \
	if ! "$$python" -c 'import venv, ensurepip' >/dev/null 2>&1; then \
	  echo "error: $$python lacks its venv module; on Debian or Ubuntu: apt install python3-venv" >&2; exit 2; \
	fi; \
	echo "making $(VENV) with $$("$$python" --version)"; \
	"$$python" -m venv --clear "$(VENV)"

$(CORE): setup.cfg $(BIN)/python
	@echo "installing what the program needs into $(VENV); this may take a minute or two"
	@$(PIP) --editable . || { echo "error: installing failed (see above); is the package index reachable?" >&2; exit 2; }
	@$(BIN)/python -c 'import faiss, numba, pandas, scipy' || { \
	  echo "error: a library does not load (see above); a system library it names may be missing" >&2; exit 2; }
	@touch "$@"

$(DEV): setup.cfg $(BIN)/python
	@echo "installing what the program and its tests need into $(VENV); this takes some minutes"
	@$(PIP) --no-compile --editable '.[dev]' || { echo "error: installing failed (see above); is the package index reachable?" >&2; exit 2; }
	@touch "$(CORE)" "$@"
