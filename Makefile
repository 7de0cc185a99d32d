# make paper and make test do all of their own set-up; they need make, a C compiler,
# Python >= 3.11 and cargo, and say what is missing.

PYTHON ?= python3
OUT ?= out/paper
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
# an older compiler cannot build the vector code for AVX-512
OLDER := $(shell cargo --version 2>/dev/null | sed -n 's/^cargo 1\.\([0-9]*\).*/\1/p' | awk '$$1 < 89')
SOURCES := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock \
    $(wildcard include/*.h tools/c/* tools/native.py)

# the tests start Python some hundred times
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help paper test test-rust test-python test-quick test-browser mutants c-test same-bits host lint lint-rust lint-python bench wasm picture screenshots docs docs-packages wheel embedded fmu-test sdist-test clean

help:
	@echo 'make paper   the figures and the checked numbers of the paper, into $(OUT)'
	@echo 'make test    all tests, Rust and Python: about ten minutes on two processors'
	@echo 'make test-quick  the tests in Python without the slow ones: about four minutes on two processors'
	@echo 'make test-browser  the pages in chromium, which must be there'
	@echo 'make c-test  the C library: its examples in C99 and C++, bad arguments, what it needs'
	@echo 'make embedded  the C library on simulated microcontrollers, where the tools are'
	@echo 'make fmu-test  the binary of the FMUs under valgrind or a sanitizer'
	@echo 'make host    the shared library for C and C++ programs on this machine, into out/host'
	@echo 'make same-bits  flights by power series built for several processors: every bit is the same'
	@echo 'make mutants mutations drawn by tools, and whether the tests notice; MUTANTS="vi --draw 20 --seed 7"'
	@echo 'make lint    formatters, linters, type checkers'
	@echo 'make bench   the benchmarks, into benchmarks/results'
	@echo 'make picture the pictures of the README and of the examples; PICTURES="hammer juggler" some of them'
	@echo 'make screenshots  pictures of the pages, with chromium; of the whole site into out/pages'
	@echo 'make docs    the documentation as a site, into out/site'
	@echo 'make wasm    the binary of the page without Python (docs/lab.md)'
	@echo 'make wheel   a wheel that runs on other machines too, tried in a fresh environment'
	@echo 'make sdist-test  the source distribution, installed with cargo and without'
	@echo 'make clean   remove everything that was built'

paper: $(VENV)/.figures
	$(BIN)/zivi paper --out $(OUT)

test: test-rust test-python

# programs to measure with (examples/) are compiled by the linter; other crates have no examples in
# their documentation; tests beside the code run in seconds, optimised they take a minute to compile
test-rust: $(VENV)/.packages
	cargo test --locked --quiet --test '*'
	cargo test --locked --quiet --lib --workspace --exclude zivi-host --exclude zivi-py --config profile.test.package.zivi.opt-level=0
	cargo test --locked --quiet --doc --package zivi-core --package zivi

# on all processors; what shares an expensive fixture, a server or the clock stays together
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadgroup

test-python: $(READY)
	$(PYTEST)

test-quick: $(READY)
	$(PYTEST) -m 'not slow and not browser'

# one after the other: a browser wants the machine for itself
test-browser: $(READY)
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || \
	    { echo 'chromium is missing: apt-get install chromium'; exit 1; }
	$(BIN)/python -m pytest -m browser

# needs cargo, a C compiler and Python, no packages
c-test:
	'$(PYTHON)' tools/native.py c
	sh tools/c-test.sh python/zivi/_native

# needs cargo; a processor with AVX2, where it is one of that family
same-bits:
	sh tools/same-bits.sh

# skipped (77) where a tool is missing, which is named
embedded:
	@sh tools/embedded.sh || test $$? = 77

fmu-test:
	'$(PYTHON)' tools/native.py fmu
	sh tools/fmu-test.sh python/zivi/_native || test $$? = 77

host:
	'$(PYTHON)' tools/native.py host

mutants: $(READY)
	$(PIP_INSTALL) mutmut
	$(BIN)/python tools/mutants --report benchmarks/results/mutants.md $(MUTANTS)

# the virtual environment with pinned packages, and the extension built into it
$(VENV)/.packages: constraints.txt pyproject.toml
	@sh tools/check-tools.sh '$(PYTHON)'
	test -x $(BIN)/python || '$(PYTHON)' -m venv $(VENV)
	$(PIP_INSTALL) maturin
	@touch $@

# the extension, with what the figures need (without the C library and the binaries of FMUs, which
# they do not), or with what the tests and linters do; packages are fetched while it is compiled
define INSTALL
$(BIN)/python tools/requirements.py $(1) >$(VENV)/requirements.txt
$(PIP_INSTALL) --requirement $(VENV)/requirements.txt & \
PATH="$(CURDIR)/$(BIN):$$PATH" $(PIP_INSTALL) --no-build-isolation --no-deps \
    $(if $(OLDER),--config-settings=build-args=--no-default-features) --editable . \
    || { wait; exit 1; }; \
wait $$!
endef

$(VENV)/.figures: export ZIVI_NATIVE = none
$(VENV)/.figures: $(VENV)/.packages $(SOURCES)
	@sh tools/check-tools.sh '$(PYTHON)'
	$(call INSTALL,cli xarray)
	@touch $@

$(READY): $(VENV)/.packages $(SOURCES)
	@sh tools/check-tools.sh '$(PYTHON)'
	$(call INSTALL,test lint)
	@touch $@ $(VENV)/.figures

lint: lint-rust lint-python

# rustfmt and clippy are parts of Rust that some installations leave out; a lint that cannot run
# fails unless SKIP_MISSING is set
lint-rust: $(VENV)/.packages
	@if cargo fmt --version >/dev/null 2>&1; then cargo fmt --all --check; \
	else echo 'cargo fmt is missing: rustup component add rustfmt'; test -n '$(SKIP_MISSING)'; fi
	@if cargo clippy --version >/dev/null 2>&1; then \
	    PYO3_PYTHON=$(CURDIR)/$(BIN)/python \
	    cargo clippy --locked --quiet --workspace --lib --tests --examples -- -D warnings && \
	    cargo clippy --locked --quiet --package zivi-c --features exports -- -D warnings && \
	    cargo clippy --locked --quiet --package zivi-c --features exports,single -- -D warnings && \
	    cargo clippy --locked --quiet --package zivi --package zivi-fmu --features zivi-fmu/loops -- -D warnings; \
	else echo 'cargo clippy is missing: rustup component add clippy'; test -n '$(SKIP_MISSING)'; fi

lint-python: $(READY)
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --quiet --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest --mypy-config-file tools/stubtest.ini zivi._zivi

# the binary of the page without Python; skipped (77) where no rustc has the target
wasm:
	@sh crates/zivi-wasm/build.sh || test $$? = 77

bench: $(READY)
	$(BIN)/python benchmarks/run.py

picture: $(READY)
	PYTHONPATH=docs/_ext $(BIN)/python tests/figure_data.py $(PICTURES)

screenshots: docs
	$(BIN)/python tests/lab_screenshot.py docs/figures
	$(BIN)/python tests/browser_screenshot.py docs/figures/browser.png
	$(BIN)/python tests/site_screenshot.py out/site out/pages

# warnings are errors; every page of the tutorial and the gallery is executed
docs-packages: $(VENV)/.docs

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -q -j 2 docs out/site
	@echo 'out/site/index.html'

# zivi is there already: this adds the packages of its extra
$(VENV)/.docs: $(READY)
	$(PIP_INSTALL) 'zivi[docs]'
	@touch $@

# zig links for systems older than this one
wheel: $(VENV)/.packages
	$(PIP_INSTALL) maturin ziglang auditwheel
	PATH="$(CURDIR)/$(BIN):$$PATH" sh tools/wheel.sh $(BIN)/python out/wheels

sdist-test: $(VENV)/.packages
	sh tools/sdist-test.sh '$(CURDIR)/$(BIN)/python' out/sdist

clean:
	rm -rf target out $(VENV) python/zivi/*.so python/zivi/_native
	find . -name __pycache__ -prune -exec rm -rf {} +
