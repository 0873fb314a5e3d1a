# Two commands for everyone: `make demo` shows the whole chain without a camera, `make test` runs every test.
# Both install the system packages they lack and say so.

# Where a folder is not ours, root must act.
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
PACKAGES := build-essential pkg-config libaravis-dev libusb-1.0-0-dev
TEST_PACKAGES := aravis-tools iproute2 util-linux

missing = $(shell for package in $(1); do dpkg-query -W -f '$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || echo $$package; done)

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## /{ printf "make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: demo
demo: packages ## Run the driver on a simulated camera, with a consumer beside it, for about ten seconds
	cargo run --release --quiet --package uvcam -- demo --out demo

.PHONY: test
test: packages test-packages ## Run every test
	cargo test --workspace --locked

.PHONY: bench
bench: packages ## Measure what masking costs beside a copy of the frame
	cargo bench --package uvcam-masker

.PHONY: packages
packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(PACKAGES)'

.PHONY: test-packages
test-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(TEST_PACKAGES)'

.PHONY: apt
apt: LACKING = $(call missing,$(NEEDED))
apt:
	@[ -z '$(strip $(LACKING))' ] || { echo 'Installing system packages: $(LACKING)'; \
		$(SUDO) apt-get update -qq && $(SUDO) apt-get install -y -qq --no-install-recommends $(LACKING); }
