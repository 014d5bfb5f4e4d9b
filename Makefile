# SPDX-License-Identifier: Apache-2.0
# The front door. `make demo` and `make test` do everything a fresh Debian machine needs.
SHELL := /bin/bash
.DEFAULT_GOAL := help
PRESET ?= release
BUILD := build/$(PRESET)
# A compiler or a test takes up to 2 GB, of the machine's memory and of the container's.
JOBS ?= $(shell { awk '/^MemAvailable:/ {print $$2 * 1e3}' /proc/meminfo; \
  cat /sys/fs/cgroup/memory.max /sys/fs/cgroup/memory/memory.limit_in_bytes 2>/dev/null; } | \
  awk -v n=$$(nproc) '$$1 + 0 > 0 && int($$1 / 2e9) < n {n = int($$1 / 2e9)} END {print n < 1 ? 1 : n}')
# Of each test: with a thread for every core, as many tests at once would have cores times cores of them.
TEST_THREADS := $(shell n=$$(nproc); echo $$((n < 4 ? n : 4)))
TIME ?= 30m
LISTS ?= build
PACKAGES = $(shell grep -hv '^\#' $(LISTS:%=deploy/packages/%.txt))
SUDO := $(if $(filter 0,$(shell id -u)),,sudo)
CC_FILES = git ls-files '*.cc' '*.h'

PICTURES ?=

.PHONY: help deps tools jobs configure build test dist packages wheel demo web web-page web-check bench train-small format lint sanitize fuzz clean

help: ## show these lines
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 16

deps: ## install the Debian packages of deploy/packages/build.txt (LISTS=build) that are missing
	@missing=$$(for p in $(PACKAGES); do dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q '^install ok' || echo $$p; done); \
	if [ -n "$$missing" ]; then \
	  $(SUDO) apt-get -o DPkg::Lock::Timeout=300 update -qq && \
	  DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get -o DPkg::Lock::Timeout=300 install -y -qq --no-install-recommends $$missing > /dev/null; \
	fi

tools: ## unpack into build/tools what tests alone run, from the packages of deploy/packages/tools.txt
	@deploy/packages/unpack.sh build/tools

jobs: # how many compilers may run at once
	@echo $(JOBS)

configure: deps
	@cmake --preset $(PRESET) > /dev/null

build: configure ## build everything (PRESET=release|asan|asan-core|tsan|clang)
	cmake --build $(BUILD) -j $(JOBS)

test: build tools ## build and run every test; those of model and engine once more under AddressSanitizer
	OMP_NUM_THREADS=$(TEST_THREADS) ctest --preset $(PRESET) -j $(JOBS)
ifeq ($(PRESET),release)
	cmake --preset asan-core > /dev/null
	cmake --build --preset asan-core -j $(JOBS)
	OMP_NUM_THREADS=$(TEST_THREADS) ctest --preset asan-core -j $(JOBS)
endif
	@/usr/bin/python3 tests/skipped.py $(BUILD) $(if $(filter release,$(PRESET)),build/asan-core)

dist: build wheel ## make the source archive, Debian packages of server, client and its library, and the wheel in out/dist
	mkdir -p out/dist
	git archive --prefix=holdfast-$$(git describe --tags --always)/ -o out/dist/holdfast-source.tar.gz HEAD
	cpack --config $(BUILD)/CPackConfig.cmake -B out/dist > /dev/null
	rm -rf out/dist/_CPack_Packages
	cp out/python/dist/*.whl out/dist
	ls -sh out/dist

packages: ## install the packages of `make dist` in a fresh Debian and use them there (root; out/packages has the logs)
	.ci/packages

# hatchling asks for what only editable installations take, and Debian 12 has not.
wheel: ## make the Python client's wheel in out/python/dist
	@$(MAKE) -s deps LISTS="build wheel"
	/usr/bin/python3 python/stage.py out/python
	cd out/python && /usr/bin/python3 -m build --wheel --no-isolation --skip-dependency-check > build.log || { cat build.log; exit 1; }
	ls out/python/dist

web-page: ## make the browser page web/dist anew (needs Node.js 20 and npm)
	web/check.sh build

web-check: ## hold web/dist against its sources, and test the page, in Chromium where a server is built
	web/check.sh

demo: configure ## track a real video through the server; the result lies in out/demo
	cmake --build $(BUILD) -j $(JOBS) --target holdfast-server holdfast
	deploy/demo.sh $(BUILD)/bin out/demo

WEB_PORT ?= 8080
web: configure ## serve the page that tracks live in a browser, at http://localhost:8080 (WEB_PORT=8080)
	cmake --build $(BUILD) -j $(JOBS) --target holdfast-server
	@echo "Open http://localhost:$(WEB_PORT) once the server is ready. Ctrl-C ends it."
	@$(BUILD)/bin/holdfast-server --listen=127.0.0.1:0 --metrics_listen=127.0.0.1:0 --web_listen=127.0.0.1:$(WEB_PORT)

bench: configure ## measure the machine, each stage and what is served (ARGS=--full, --compare=OLD.json): out/bench.json
	cmake --build $(BUILD) -j $(JOBS) --target holdfast-model-benchmark holdfast-server holdfast
	/usr/bin/python3 tests/benchmark/bench.py $(BUILD)/bin $(ARGS)

train-small: configure ## train preset small for TIME=30m on synthetic scenes (PICTURES=dir); see out/train-small
	cmake --build $(BUILD) -j $(JOBS) --target holdfast-train
	$(BUILD)/bin/holdfast-train --preset=small --time_budget=$(TIME) --pictures=$(PICTURES) --out=out/train-small

format: deps ## format the C++ sources in place
	$(CC_FILES) | xargs clang-format -i

lint: ## check format, and the whole tree by clang-tidy and clang's thread-safety analysis
	JOBS=$(JOBS) .ci/lint

sanitize: ## run every test under AddressSanitizer with UndefinedBehaviorSanitizer, then under ThreadSanitizer
	JOBS=$(JOBS) OMP_NUM_THREADS=$(TEST_THREADS) .ci/sanitize

fuzz: ## run each fuzz target with libFuzzer for SECONDS=300
	JOBS=$(JOBS) .ci/fuzz $(or $(SECONDS),300)

clean: ## remove build and out
	rm -rf build out
