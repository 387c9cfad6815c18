# The whole way from a fresh clone to the published report: `make help` lists the targets.

# venv takes no colon, the first lines of pip's programs no quotes and dollars, Sphinx no wildcards.
$(foreach c,: " $$ ` \ * ? [ ],$(if $(findstring $c,$(CURDIR)),\
  $(error The path of this folder contains $c, which venv, pip or Sphinx cannot take: $(CURDIR))))

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Each stamp is made by the last command of its rule, so an interrupted step counts as not done.
LOCKED := $(VENV)/.locked
TOOLS := $(VENV)/.tools
INSTALLED := $(VENV)/.installed
BUILT := _build/.built

# Left out: copies such as "10_model-Copy1.ipynb", and names that make would take apart.
STUDIES = $(shell ls -r $(1) 2> /dev/null | grep -xE '[0-9]{2}_[0-9a-z_]+\.ipynb')
NOTEBOOKS := $(addprefix notebooks/,$(call STUDIES,notebooks))
# Those that measure times begin first: they prepare themselves beside the others, and then wait
# until they have the machine alone.
CALLED := \bmeasure\(
TIMED := $(shell grep -lE '$(CALLED)' $(NOTEBOOKS) /dev/null)
RESULTS := $(patsubst notebooks/%,book/results/%,$(TIMED) $(filter-out $(TIMED),$(NOTEBOOKS)))
STALE := $(filter-out $(RESULTS),$(addprefix book/results/,$(call STUDIES,book/results)))
PLAIN := ! -path '*[!-+./0-9A-Z_a-z]*'
# What a notebook can read. Expected results (data/expected) and claims only judge, they do not enter.
INPUTS := $(shell find src data $(wildcard examples) \( -name __pycache__ -o -name '.*' -o -path data/expected \
            -o -name claims.toml -o -name second_opinions.toml \) -prune -o -type f $(PLAIN) -print)
PAGES := $(shell find book *.md -name results -prune -o -type f ! -name '.*' $(PLAIN) -print) \
         _config.yml _toc.yml

# The tests, on all processors, in as many processes as tests/conftest.py says.
PYTEST := $(BIN)/python -m pytest -n auto --dist=worksteal
# Sphinx keeps nearly all of its objects. A search for garbage among them would take a third of the time.
JUPYTER_BOOK := $(BIN)/python -c 'import gc; gc.disable(); from jupyter_book.cli.main import main; main()'

SHELL := /bin/bash
# What the user has set for other programs must not change a result.
unexport $(filter-out PYTHON NUMBA_CACHE_DIR,$(filter PYTHON% NUMBA_% MPL% MATPLOTLIBRC BASH_ENV,$(.VARIABLES)))
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export MPLCONFIGDIR := $(CURDIR)/$(VENV)/.matplotlib
# The matrices are small: more threads would only wait, and keep other processes from working.
export OPENBLAS_NUM_THREADS := 1

.PHONY: help install tools book pdf check style test fuzz coverage clean distclean forget moved
.DELETE_ON_ERROR:

help:
	@echo 'make install    make the environment .venv'
	@echo "make tools      the same, and the developers' packages"
	@echo 'make book       the same, then execute the notebooks that need it and build the HTML'
	@echo 'make pdf        the same, and the book as one PDF, printed by Chromium'
	@echo 'make test       build everything from clean, then lint, type-check and run every test'
	@echo 'make check      the same without the clean start'
	@echo 'make fuzz       try the tests that draw examples with many new ones'
	@echo 'make coverage   run the tests and show which lines of the packages they reach'
	@echo 'make clean      remove what was built'
	@echo 'make distclean  remove the environment and the machine code as well'
	@echo
	@echo 'PYTHON=python3.12 make book  takes another Python than python3 (3.11 to 3.13)'

book: $(BUILT)
	@echo "The report: $$PWD/_build/html/index.html"

# Each lock is complete, and nothing is left to resolve: where a package asks for another with an
# extra, the resolver would look at a newer version than the lock has, and stop for lack of a hash.
# Nothing is compiled either: without a compiler that ends in pages of errors after minutes.
define FETCH
	@set -o pipefail; $(BIN)/python -m pip install --no-deps --require-hashes --only-binary=:all: -r $< | \
	  awk '/^(Collecting|Processing)/ && ++n % 25 == 0 { print "  " n " packages fetched"; fflush() } \
	       /^Installing/ { print "  installing " n " packages"; fflush() }'
	@$(BIN)/python -m pip check > /dev/null || $(BIN)/python -m pip check >&2
	@touch $@
endef

$(LOCKED): environment.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' || \
	  { echo 'armsim needs Python 3.11, 3.12 or 3.13, and $(PYTHON) is'; $(PYTHON) --version; \
	    echo 'Name another: make PYTHON=python3.12 $(MAKECMDGOALS)'; exit 1; } >&2
	@$(PYTHON) -c 'import platform, sys, sysconfig; here = platform.system(), platform.machine(); \
	  musl = "musl" in str(sysconfig.get_config_var("HOST_GNU_TYPE")); \
	  sys.exit(musl or here not in [("Linux", "x86_64"), ("Linux", "aarch64"), ("Darwin", "arm64")])' || \
	  { echo 'The packages are locked for Linux (x86_64 or aarch64, with glibc) and macOS (arm64), and this is'; \
	    $(PYTHON) -c 'import sysconfig; print(sysconfig.get_platform())'; exit 1; } >&2
	@$(PYTHON) -c 'import venv, ensurepip' || \
	  { echo 'Python lacks venv; on Debian and Ubuntu: apt-get install python3-venv' >&2; exit 1; }
	@echo 'Making $(VENV) with $(shell $(PYTHON) --version 2>&1)'
	@rm -f $@
	@$(PYTHON) -m venv --clear $(VENV)
	@echo 'Installing the locked packages, a minute or two'
	$(FETCH)

# What the book does not need: whatever is made with it does not depend on this.
$(TOOLS): environment-dev.txt $(LOCKED) | $(INSTALLED)
	@echo "Installing the developers' packages"
	$(FETCH)
tools: $(TOOLS)

# The package itself. A change of pyproject.toml that matters to results changes the lock too. The
# stamp holds the path of this folder, because .venv/bin does. So rules start programs as modules.
MOVED := $(shell [ ! -e $(INSTALLED) ] || grep -qxF "$$(pwd -P)" $(INSTALLED) || echo moved)
$(INSTALLED): pyproject.toml $(LOCKED) $(MOVED)
	@$(if $(MOVED),echo 'The folder has a new path: renewing "armsim"; "make distclean install" renews all programs')
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@pwd -P > $@
install: $(INSTALLED)

# A rule notes what it makes beside its target. If one of these files is missing, it runs again.
NOTE = @find $(@D) -name '$(1)[-.]*' ! -path $@ | sed 'h;s|^|$@: |p;g;s|$$|:|' > $(@D)/.$(1).d; touch $@
-include $(wildcard book/results/.*.d)
book/results/%.ipynb: notebooks/%.ipynb $(INPUTS) $(LOCKED) | $(INSTALLED)
	@$(BIN)/python -m reportkit.execute $< $(@D)
	$(call NOTE,$*)

# Two at a time, and those that wait to measure times alone. A make started by another has its jobs.
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += --jobs=$(words 1 2 $(TIMED))
endif

# What the pages show of all results together: the verdicts; the modules, versions and data.
SUMMARIES := $(addprefix book/results/,verdicts.md appendix-architecture.svg)
$(SUMMARIES): $(RESULTS) $(INPUTS) $(LOCKED) data/paper/claims.toml data/second_opinions.toml $(if $(STALE),forget)
book/results/verdicts.md:
	@$(BIN)/python -m reportkit.claims $(@D)
	$(call NOTE,verdicts)
book/results/appendix-architecture.svg:
	@$(BIN)/python -m armbook.architecture $(@D)
	$(call NOTE,appendix)

# From scratch each time: an incremental build would leave old numbers on pages that quote them.
$(BUILT): $(PAGES) $(RESULTS) $(SUMMARIES) $(LOCKED) $(if $(STALE),forget) | $(INSTALLED)
	@echo 'Building the HTML'
	@rm -rf $@ _build/html _build/.doctrees
	@$(JUPYTER_BOOK) build . -W --keep-going -n -q > /dev/null
	@touch $@

# The book as one page, printed. Its pages have just been read for the HTML.
PDF := _build/armsim.pdf
pdf: $(PDF)
	@echo "The PDF: $$PWD/$(PDF)"

$(PDF): $(BUILT)
	@echo 'Building the PDF'
	@rm -rf _build/singlehtml
	@$(JUPYTER_BOOK) build . --builder singlehtml -W --keep-going -n -q > /dev/null
	@$(BIN)/python -m reportkit.pdf _build/singlehtml/index.html $@

# The results of a notebook that is no more must not be published.
forget:
	@echo 'Removing results without a notebook: $(notdir $(STALE))'
	@rm -f $(STALE) $(STALE:.ipynb=.json) $(STALE:.ipynb=-*)

check: style book
	@echo 'Comparing what was built with what is expected'
	@$(BIN)/python -m armbook.cli check
	@echo 'Running the tests'
	@$(PYTEST)

# A file against the schema of the service that reads it.
VALID = @$(BIN)/python -m check_jsonschema --quiet --builtin-schema vendor.$(1) $(2)
style: tools
	@echo 'Checking style and types'
	@$(BIN)/python -m ruff check .
	@$(BIN)/python -m ruff format --check .
	@$(BIN)/python -m mypy
	@$(BIN)/zizmor --offline --quiet --pedantic .github
	@$(BIN)/hadolint Dockerfile
	$(call VALID,github-workflows,.github/workflows/*.yml)
	$(call VALID,github-issue-forms,.github/ISSUE_TEMPLATE/*.yml)
	$(call VALID,dependabot,.github/dependabot.yml)
	$(call VALID,citation-file-format,CITATION.cff)

test: clean
	@$(MAKE) --no-print-directory check

# New examples each time. Those that fail are kept in .hypothesis and tried first the next time.
SEED := $(shell date +%s)
fuzz: tools
	@echo 'To try the same examples again: make fuzz SEED=$(SEED)'
	@FUZZ_SEED=$(SEED) $(PYTEST) -m hypothesis --hypothesis-profile=fuzz

coverage: tools book
	@$(PYTEST) --cov

clean:
	@echo 'Removing what was built'
	@rm -rf _build book/results .pytest_cache .mypy_cache .ruff_cache .coverage

distclean: clean
	@rm -rf $(VENV) .hypothesis
	@find src tests -name __pycache__ -exec rm -rf {} +
