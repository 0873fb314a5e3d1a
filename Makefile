# Three commands for everyone: `make demo` shows the whole chain without a camera, `make test` runs every test, `make lab` those that
# need a kernel with cameras.
# They install the system packages they lack and say so.

# Where a folder is not ours, root must act.
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
PACKAGES := build-essential pkg-config libclang-dev libaravis-dev libusb-1.0-0-dev
TEST_PACKAGES := aravis-tools clang cmake iproute2 libopencv-core-dev python3 systemd udev util-linux valgrind
PYTHON_PACKAGES := python3 python3-venv
LAB_PACKAGES := binutils busybox-static qemu-system-x86 udev
# ROS 1 of Debian.
ROS_PACKAGES := catkin cmake libcamera-info-manager-dev libdiagnostic-updater-dev libnodelet-dev libnodeletlib-dev libnodeletlib-tools \
	libroscpp-dev libsensor-msgs-dev pluginlib-dev python3-diagnostic-msgs python3-roslaunch python3-rosmaster python3-rospy python3-sensor-msgs
# What `make bench` compares with, beside ROS 1; it does without what cannot be installed.
GSTREAMER_PACKAGES := gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-bad libgstreamer-plugins-base1.0-dev
DEB_TEST_PACKAGES := mmdebstrap systemd-container

# Instrumented without a sanitizer, which the stable toolchain can do; built to be built fast.
CARGO_FUZZ := CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_OPT_LEVEL=1 cargo fuzz
FUZZ_BUILD := --sanitizer none --codegen-units 16 --fuzz-dir tests/fuzz --target-dir target/fuzz

# Where `make install` puts what, and what it takes.
PREFIX ?= /usr/local
DESTDIR ?=
BINARY ?= $(or $(CARGO_TARGET_DIR),target)/release/uvcam

# What `make fuzz` runs.
FUZZ ?= png config header control clock

# Where `make lab` keeps its kernel, and `make python` what it tests with.
LAB := target/lab
PYTHON := target/python

missing = $(shell for package in $(1); do dpkg-query -W -f '$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || echo $$package; done)

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{ printf "make %-11s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: demo
demo: packages ## Run the driver on a simulated camera, with a consumer beside it, for about ten seconds
	cargo run --release --locked --package uvcam -- demo --out demo

.PHONY: test
test: packages test-packages ## Run every test
	cargo test --workspace --locked --no-fail-fast

# Whoever leaves out a kind of camera has neither its library nor warnings. One after the other: they share all that is built before.
.PHONY: features
features: packages ## Check the driver with every choice of camera kinds
	cargo clippy --locked --package uvcam --all-targets --no-default-features -- -D warnings
	cargo clippy --locked --package uvcam --all-targets --no-default-features --features aravis -- -D warnings
	cargo clippy --locked --package uvcam --all-targets --no-default-features --features v4l2 -- -D warnings
	cargo test --locked --package uvcam --lib --no-default-features

.PHONY: lab
lab: packages lab-packages $(LAB)/kernel ## Run the driver on emulated cameras behind a real kernel, in a virtual machine
	cargo run --quiet --locked --package uvcam-tests --bin lab -- $(LAB) $(TESTS)

# Debian's kernel for real machines, which has drivers for cameras. Unpacked, not installed.
$(LAB)/kernel:
	rm -rf $(LAB)/package $@.part && mkdir -p $(LAB)/package
	cd $(LAB)/package && apt-get download $$(apt-cache depends linux-image-amd64 | awk '/Depends: linux-image-/ { print $$2 }')
	dpkg -x $(LAB)/package/*.deb $@.part
	busybox depmod -b $@.part $$(ls $@.part/lib/modules)
	mv $@.part $@

# With no more than their optimisation left out, the user's way: pip builds the package and installs it.
.PHONY: python
python: packages $(PYTHON)/requirements.txt ## Build the Python package and test it with a real driver
	cargo build --locked --package uvcam
	cargo build --locked --package uvcam-tests --example publisher
	PATH=$(abspath $(PYTHON))/bin:$$PATH MATURIN_PEP517_ARGS='--profile dev --locked' \
		$(PYTHON)/bin/pip install --quiet --no-build-isolation --no-deps ./shm_ipc/python
	cd shm_ipc/python && $(abspath $(PYTHON))/bin/mypy
	$(PYTHON)/bin/stubtest uvcam._uvcam
	cd shm_ipc/python && $(abspath $(PYTHON))/bin/pytest $(TESTS)

$(PYTHON)/requirements.txt: shm_ipc/python/tests/requirements.txt
	@$(MAKE) --no-print-directory apt NEEDED='$(PYTHON_PACKAGES)'
	python3 -m venv --clear $(PYTHON)
	$(PYTHON)/bin/pip install --quiet --requirement $<
	cp $< $@

.PHONY: fuzz
fuzz: $(FUZZ:%=fuzz-%) ## Fuzz what comes from outside; FUZZ_S=20 is twenty seconds a target, RUNS=10000000 that many inputs, SEED=1 the same ones each time, FUZZ=png one of them

.PHONY: fuzz-build
fuzz-build: packages
	@command -v cargo-fuzz >/dev/null || cargo install cargo-fuzz --locked --quiet
	$(CARGO_FUZZ) build $(FUZZ_BUILD)
	target/fuzz/*/release/seeds tests/fuzz/corpus

fuzz-%: fuzz-build
	$(CARGO_FUZZ) run $(FUZZ_BUILD) $* -- $(addprefix -dict=,$(wildcard tests/fuzz/dictionaries/$*.dict)) \
		$(if $(RUNS),-runs=$(RUNS),-max_total_time=$(or $(FUZZ_S),60)) \
		-seed=$(or $(SEED),0) -max_len=4096 -rss_limit_mb=512 -timeout=30 -verbosity=0 -print_final_stats=1

.PHONY: bench
bench: packages bench-packages ## Compare the driver with other ways to carry frames; BENCH='--rounds 1 --seconds 2' is quick
	cargo bench --locked --package uvcam-tests --bench peers -- $(BENCH)

.PHONY: microbench
microbench: packages ## Measure the parts of the frame path
	cargo bench --locked --workspace --exclude uvcam-tests

.PHONY: soak
soak: packages test-packages ## Ten minutes each of cameras that do not grow, and of consumers that stop and die; SOAK_S=60 is a minute each
	UVCAM_SOAK_S=$(or $(SOAK_S),600) cargo test --release --locked --package uvcam-tests --test soak -- --nocapture --test-threads 1

.PHONY: build
build: packages ## Build the driver for flight
	cargo build --release --locked --package uvcam

# Built before, by whoever has the toolchain; root seldom has.
.PHONY: install
install: ## Install the built driver with udev rules, service and configuration (PREFIX=/usr/local, DESTDIR=)
	@[ -x '$(BINARY)' ] || { echo '$(BINARY) is missing: run `make build` first' >&2; exit 1; }
	install -D -m 755 '$(BINARY)' '$(DESTDIR)$(PREFIX)/bin/uvcam'
	install -D -m 644 udev/70-uvcam.rules '$(DESTDIR)$(PREFIX)/lib/udev/rules.d/70-uvcam.rules'
	install -D -m 644 udev/uvcam.sysusers '$(DESTDIR)$(PREFIX)/lib/sysusers.d/uvcam.conf'
	install -D -m 644 udev/uvcam.service '$(DESTDIR)$(PREFIX)/lib/systemd/system/uvcam.service'
	sed -i 's|/usr/bin/uvcam|$(PREFIX)/bin/uvcam|' '$(DESTDIR)$(PREFIX)/lib/systemd/system/uvcam.service'
	install -D -m 644 udev/network.conf '$(DESTDIR)$(PREFIX)/share/uvcam/network.conf'
	[ -e '$(DESTDIR)/etc/uvcam/uvcam.toml' ] || install -D -m 644 udev/uvcam.toml '$(DESTDIR)/etc/uvcam/uvcam.toml'
	[ -n '$(DESTDIR)' ] || $(MAKE) --no-print-directory activate

# What an installation changes in the running system.
.PHONY: activate
activate:
	systemd-sysusers uvcam.conf
	sh udev/debian/postinst configure
	[ ! -d /run/systemd/system ] || systemctl daemon-reload

.PHONY: uninstall
uninstall: ## Remove what `make install` installed, but a configuration that was changed, masks and the service's user
	[ -n '$(DESTDIR)' ] || [ ! -d /run/systemd/system ] || systemctl disable --now uvcam.service
	rm -f '$(DESTDIR)$(PREFIX)/bin/uvcam'
	rm -f '$(DESTDIR)$(PREFIX)/lib/udev/rules.d/70-uvcam.rules'
	rm -f '$(DESTDIR)$(PREFIX)/lib/sysusers.d/uvcam.conf'
	rm -f '$(DESTDIR)$(PREFIX)/lib/systemd/system/uvcam.service'
	rm -rf '$(DESTDIR)$(PREFIX)/share/uvcam'
	! cmp -s udev/uvcam.toml '$(DESTDIR)/etc/uvcam/uvcam.toml' || rm -r '$(DESTDIR)/etc/uvcam'

.PHONY: c
c: ## Build libuvcam, which gives frames to programs in C and C++
	$(MAKE) --no-print-directory -C shm_ipc/c

.PHONY: install-c
install-c: ## Install it with its headers, pkg-config file and CMake package (PREFIX=/usr/local, DESTDIR=)
	$(MAKE) --no-print-directory -C shm_ipc/c install

.PHONY: uninstall-c
uninstall-c: ## Remove what `make install-c` installed
	$(MAKE) --no-print-directory -C shm_ipc/c uninstall

.PHONY: deb
deb: packages ## Build the Debian package, target/debian/uvcam_*.deb
	@command -v cargo-deb >/dev/null || cargo install cargo-deb --locked --quiet
	cargo deb --locked --package uvcam

.PHONY: deb-test
deb-test: deb ## Install the Debian package on a clean system, in a container, and try the service there
	@$(MAKE) --no-print-directory apt NEEDED='$(DEB_TEST_PACKAGES)'
	$(SUDO) tests/deb.sh $(or $(CARGO_TARGET_DIR),target)/debian/uvcam_*.deb

.PHONY: packages
packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(PACKAGES)'

.PHONY: test-packages
test-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(TEST_PACKAGES) $(ROS_PACKAGES)'

.PHONY: bench-packages
bench-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(GSTREAMER_PACKAGES)' || echo 'GStreamer cannot be installed.'
	@$(MAKE) --no-print-directory apt NEEDED='$(ROS_PACKAGES)' || echo 'ROS 1 cannot be installed.'

.PHONY: ros-packages
ros-packages: ## Install the packages of ROS 1 that shm_ipc/ros is built with
	@$(MAKE) --no-print-directory apt NEEDED='$(ROS_PACKAGES)'

.PHONY: lab-packages
lab-packages:
	@$(MAKE) --no-print-directory apt NEEDED='$(LAB_PACKAGES)'

.PHONY: apt
apt: LACKING = $(call missing,$(NEEDED))
apt:
	@[ -z '$(strip $(LACKING))' ] || { echo 'Installing system packages: $(LACKING)'; \
		$(SUDO) apt-get update -qq && $(SUDO) apt-get install -y -qq --no-install-recommends $(LACKING); }
