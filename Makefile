# Everything here needs only Python (>= 3.11) and make: the first target that wants them builds .venv.

PYTHON ?= python3
PIP_ARGS ?=
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
PIP_INSTALL := $(BIN)/python -m pip install --no-input --disable-pip-version-check -c constraints.txt $(PIP_ARGS)

# Each learning library that examples/clients shows: what it needs is in examples/clients/NAME.txt, its test is
# tests/clients/test_NAME.py, and both meet in .venv-clients/NAME, since their requirements exclude each other.
CLIENTS := $(sort $(basename $(notdir $(wildcard examples/clients/*.txt))))

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help train rules test test-all nightly clients map kernels kernels-wheel docs notebooks lint format bench hooks clean distclean

help:
	@echo "make train    train a policy, compare it with the rules, write runs/   (ARGS='--help' lists its options)"
	@echo "make rules    make what ships of the rules in the tasks, runs/ keeps it  (ARGS='competitive-door' of this alone)"
	@echo "make test     run the tests of the laws, under two minutes             (ARGS='tests/physics' these alone)"
	@echo "make test-all run all tests but those of a night;  make nightly: those"
	@echo "make clients  try each learning library in an environment of its own   (ARGS='torchrl sb3' these alone)"
	@echo "make map      hold crowds against laws, two minutes                    (ARGS='gate --data DIR' against recordings)"
	@echo "make kernels  run the marked tests uncompiled, and say which lines of the kernels they reach"
	@echo "make kernels-wheel compile for others: a wheel in dist/, with which a first step need not compile"
	@echo "make docs     build the site, build/docs/index.html; warnings are errors"
	@echo "make notebooks execute the notebooks of docs/ anew, in place               (ARGS='pedpy' this alone)"
	@echo "make lint     check style, types and layers"
	@echo "make format   format the code and mend what can be mended by machine"
	@echo "make bench    measure the speed                                        (ARGS='--json' for a program)"
	@echo "make hooks    run the checks at every git commit"
	@echo "make clean    remove caches and build outputs (make distclean: .venv, .venv-clients too; runs/ stays)"
	@echo "Variables: PYTHON=$(PYTHON) (3.11 or newer), ARGS, PIP_ARGS (options for pip, such as another index)"

train: $(VENV)/.train
	$(BIN)/python train.py $(ARGS)

rules: $(VENV)/.train
	$(BIN)/crowd-env rules $(ARGS)

PYTEST := $(BIN)/python -m pytest -n 2 --dist worksteal --durations 10 --durations-min 1

test: $(VENV)/.dev
	$(PYTEST) $(ARGS)

test-all: $(VENV)/.dev
	$(PYTEST) -m "not nightly" $(ARGS)

nightly: $(VENV)/.dev
	$(PYTEST) -m nightly $(ARGS)

# All are tried before one that failed ends it.
clients:
	$(if $(filter-out $(CLIENTS),$(ARGS)),$(error there is no client $(filter-out $(CLIENTS),$(ARGS)); known: $(CLIENTS)))
	@failed=; for client in $(or $(ARGS),$(CLIENTS)); do \
	  $(MAKE) --no-print-directory client-$$client || failed="$$failed $$client"; done; \
	  [ -z "$$failed" ] || { echo "These clients failed, see above:$$failed" >&2; exit 1; }

client-%: $(VENV)-clients/%/.made
	$(VENV)-clients/$*/bin/python -m pytest -m "" --durations 3 tests/clients/test_$*.py

map: $(VENV)/.dev
	$(BIN)/python -m validation $(or $(ARGS),--quick)

# Marked tests and the files that hold kernels are found by what stands in them, wherever they lie; the other tests are not
# even imported: some make their plans as they are, which takes a minute uncompiled.
kernels: $(VENV)/.dev
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "kernels and not nightly" --cov=crowd_env --cov-report= $(ARGS) \
	  $$(grep -rlE --include='*.py' 'pytest\.mark\.kernels' tests)
	$(BIN)/python -m coverage report --fail-under=85 \
	  --include="$$(grep -rlE --include='*.py' '^@(inner_|allocating_)?kernel$$' crowd_env | paste -sd, -)"

kernels-wheel: $(VENV)/.dev
	$(BIN)/python -m benchmarks.kernels_wheel

# Everything is read anew each time: a page that is only taken over from the last build would warn of nothing.
docs: $(VENV)/.dev
	$(BIN)/python -m sphinx -E -W --keep-going -q -d build/doctrees docs build/docs $(ARGS)
	@echo "build/docs/index.html"

notebooks: $(VENV)/.dev
	$(BIN)/python -m docs.notebooks.execute $(ARGS)

lint: $(VENV)/.dev
	$(BIN)/python -m ruff check
	$(BIN)/python -m ruff format --check
	$(BIN)/python -m mypy
	$(BIN)/lint-imports --no-logo --no-cache

format: $(VENV)/.dev
	$(BIN)/python -m ruff check --fix
	$(BIN)/python -m ruff format

bench: $(VENV)/.train
	$(BIN)/python -m benchmarks $(ARGS)

hooks: $(VENV)/.dev
	$(BIN)/python -m pre_commit install

clean:
	rm -rf build dist *.egg-info .coverage .mypy_cache .pytest_cache .ruff_cache
	find . -path ./$(VENV) -prune -o -path ./$(VENV)-clients -prune -o -path ./runs -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV) $(VENV)-clients

# Each stamp says "these extras are installed as pyproject.toml and constraints.txt want them". It goes before the
# installation starts and comes back only when all of it has succeeded. .dev contains .train.

define check_python
@command -v $(PYTHON) >/dev/null 2>&1 && $(PYTHON) -c "" 2>/dev/null || \
  { echo "crowd_env needs Python 3.11 or newer, and '$(PYTHON)' does not run: install it, or name one with 'make PYTHON=...'." >&2; exit 1; }
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
  { echo "crowd_env needs Python 3.11 or newer, and '$(PYTHON)' is $$($(PYTHON) -V 2>&1): name a newer one with 'make PYTHON=...'." >&2; exit 1; }
@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
  { echo "'$(PYTHON)' lacks the venv module: install it (Debian, Ubuntu: apt install python3-venv), or name another with 'make PYTHON=...'." >&2; exit 1; }
endef

# A half-made or broken .venv (interrupted, its Python gone or too old) is made again from scratch.
define make_venv
@rm -f $(VENV)/.train $(VENV)/.dev
@$(BIN)/python -c 'import pip, sys; sys.exit(sys.prefix == sys.base_prefix or sys.version_info < (3, 11))' 2>/dev/null || \
  { echo "Building $(VENV), a few minutes the first time ..."; \
    $(PYTHON) -m venv --clear $(VENV); }
endef

# scikit-fmm comes as source on Linux.
install_failed = { echo "Installing failed, see above. If it was scikit-fmm: it is compiled here and wants a C++ compiler (Debian, Ubuntu: apt install g++ python3-dev)." >&2; exit 1; }

$(VENV)/.train: pyproject.toml constraints.txt
	$(check_python)
	$(make_venv)
	@$(PIP_INSTALL) -e '.[train,render]' || $(install_failed)
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt
	$(check_python)
	$(make_venv)
	@$(PIP_INSTALL) -e '.[train,render,dev]' || $(install_failed)
	@touch $(VENV)/.train $@

.PRECIOUS: $(VENV)-clients/%/.made
$(VENV)-clients/%/.made: examples/clients/%.txt pyproject.toml constraints.txt
	$(check_python)
	@echo "Building $(@D) ..."
	@$(PYTHON) -m venv --clear $(@D)
	@$(@D)/bin/python -m pip install --no-input --disable-pip-version-check $(PIP_ARGS) -e . -r $< pytest || $(install_failed)
	@touch $@
