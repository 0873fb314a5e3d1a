#!/usr/bin/env bash
# Installs a Debian package of uvcam on a clean system, made in a folder from the distribution's own packages, boots that system as a
# container, and tries the service there. Called by `make deb-test`, as root: tests/deb.sh PACKAGE
set -euo pipefail

[ "$#" = 1 ] && [ -f "$1" ] || { echo "one package, not: $*" >&2; exit 2; }
root=$(mktemp -d)
trap 'rm -rf --one-file-system "$root"' EXIT
. /etc/os-release
mmdebstrap --quiet --variant=apt --include=systemd-sysv,dbus \
    --customize-hook="cp '$(realpath "$1")' \"\$1/uvcam.deb\"" \
    --customize-hook='chroot "$1" apt-get -qq install --no-install-recommends /uvcam.deb >/dev/null' \
    "$VERSION_CODENAME" "$root"

# What runs inside; a command that fails ends it all.
cat >"$root/inside.sh" <<'INSIDE'
set -eux

# Every file as it was packed, with its mode and owner.
test -z "$(dpkg --verify uvcam)"
if stat -c '%a %U:%G %F %n' $(dpkg -L uvcam) | grep -v -x -e '755 root:root directory .*' \
    -e '644 root:root regular file .*' -e '755 root:root regular file /usr/bin/uvcam'; then
    exit 1
fi
for name in /etc/uvcam/uvcam.toml /usr/lib/systemd/system/uvcam.service /usr/lib/sysusers.d/uvcam.conf \
    /usr/lib/udev/rules.d/70-uvcam.rules /usr/share/uvcam/network.conf /usr/share/doc/uvcam/copyright; do
    test -f "$name"
done

# The service: not started before it is configured, its user in the groups of devices.
systemd-analyze verify uvcam.service
test "$(systemctl is-enabled uvcam.service || true)" = disabled
id uvcam | grep plugdev | grep video

# It flies with all that is forbidden to it, and a consumer of the same user sees every frame.
watch() {
    setpriv --reuid uvcam --regid uvcam --init-groups \
        uvcam watch simulated --config /etc/uvcam/uvcam.toml --frames 60 --timeout 20
}
systemctl start uvcam
watch
test "$(stat -c '%a %U' /run/uvcam)" = '700 uvcam'
test "$(stat -c '%a %U' /var/lib/uvcam)" = '755 uvcam'
systemctl reload uvcam
watch
test "$(systemctl show --property NRestarts --value uvcam)" = 0

# Killed, it comes back.
systemctl kill --signal KILL uvcam
watch
test "$(systemctl show --property NRestarts --value uvcam)" = 1

# A wrong configuration is not tried again and again.
echo 'wrong' >>/etc/uvcam/uvcam.toml
systemctl restart uvcam || true
timeout 20 sh -c 'until systemctl is-failed uvcam; do sleep 0.1; done'
sed -i '/^wrong$/d' /etc/uvcam/uvcam.toml
systemctl start uvcam
watch

# Removed, it is stopped and leaves its configuration; purged, nothing but its user.
apt-get -qq remove uvcam >/dev/null
test "$(systemctl is-active uvcam || true)" = inactive
test ! -e /usr/bin/uvcam
test ! -e /usr/lib/udev/rules.d/70-uvcam.rules
test -f /etc/uvcam/uvcam.toml
apt-get -qq purge uvcam >/dev/null
test ! -e /etc/uvcam
INSIDE
cat >"$root/etc/systemd/system/inside.service" <<'UNIT'
[Service]
Type=oneshot
ExecStart=/bin/sh -c '(sh /inside.sh && touch /passed) >/said 2>&1; systemctl poweroff --no-block'
UNIT
ln -s /etc/systemd/system/inside.service "$root/etc/systemd/system/multi-user.target.wants/"

# Under systemd the container gets a unit of its own; elsewhere there is none to get.
unit=(--keep-unit)
[ ! -d /run/systemd/system ] || unit=()
timeout --kill-after 10 180 systemd-nspawn --quiet --directory "$root" --boot --private-network --register=no \
    "${unit[@]}" --console=pipe </dev/null >"$root/console" 2>&1 || cat "$root/console"
cat "$root/said"
[ -e "$root/passed" ] || { echo "$1: failed on a clean $PRETTY_NAME, at the last command above" >&2; exit 1; }
echo "$1: installed, flown, removed and purged on a clean $PRETTY_NAME"
