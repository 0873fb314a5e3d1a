# Two commands for everyone: `make demo` shows the whole chain without a camera, `make test` runs every test.
# Both install the system packages they lack and say so.

# Where a folder is not ours, root must act.
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
PACKAGES := build-essential pkg-config libaravis-dev libusb-1.0-0-dev
TEST_PACKAGES := aravis-tools iproute2 util-linux
# What `make bench` compares with; it does without what cannot be installed.
GSTREAMER_PACKAGES := gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-bad libgstreamer-plugins-base1.0-dev
ROS_PACKAGES := libroscpp-dev libsensor-msgs-dev python3-rosmaster

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
bench: packages bench-packages ## Compare the driver with other ways to carry frames; BENCH='--rounds 1 --seconds 2' is quick
	cargo bench --locked --package uvcam-tests --bench peers -- $(BENCH)

.PHONY: microbench
microbench: packages ## Measure the parts of the frame path
	cargo bench --locked --workspace --exclude uvcam-tests

.PHONY: soak
soak: packages test-packages ## Ten minutes of three cameras among consumers that stop and die; SOAK_S=60 is one minute
	UVCAM_SOAK_S=$(or $(SOAK_S),600) cargo test --release --locked --package uvcam-tests --test soak -- --nocapture

.PHONY: packages
packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(PACKAGES)'

.PHONY: test-packages
test-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(TEST_PACKAGES)'

.PHONY: bench-packages
bench-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(GSTREAMER_PACKAGES)' || echo 'GStreamer cannot be installed.'
	@$(MAKE) --no-print-directory apt NEEDED='$(ROS_PACKAGES)' || echo 'ROS 1 cannot be installed.'

.PHONY: apt
apt: LACKING = $(call missing,$(NEEDED))
apt:
	@[ -z '$(strip $(LACKING))' ] || { echo 'Installing system packages: $(LACKING)'; \
		$(SUDO) apt-get update -qq && $(SUDO) apt-get install -y -qq --no-install-recommends $(LACKING); }
