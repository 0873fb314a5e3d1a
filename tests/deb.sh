#!/usr/bin/env bash
# Installs the Debian package of `make deb` on a clean system, which is made in a folder from the distribution's own packages, and
# tries it there. Called by `make deb-test`.
set -euo pipefail
cd "$(dirname "$0")/.."

packages=("${CARGO_TARGET_DIR:-target}"/debian/uvcam_*.deb)
[ "${#packages[@]}" = 1 ] && [ -e "${packages[0]}" ] || { echo "not one package: ${packages[*]}" >&2; exit 1; }

# What runs inside; a command that fails ends it all.
inside=$(mktemp)
trap 'rm -f "$inside"' EXIT
cat >"$inside" <<'INSIDE'
set -eux
export DEBIAN_FRONTEND=noninteractive
apt_get() { apt-get -qq -o Dpkg::Use-Pty=0 -o Dpkg::Progress-Fancy=0 "$@" >/dev/null; }
apt_get install --no-install-recommends /uvcam.deb

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

# The service: known to systemd, its user and groups there, not started before it is configured.
systemd-analyze verify /usr/lib/systemd/system/uvcam.service
test "$(systemctl is-enabled uvcam.service || true)" = disabled
getent passwd uvcam
getent group plugdev video

# The driver flies, as the service's user and with the service's configuration, and a consumer sees it.
install -d -m 700 -o uvcam -g uvcam /run/uvcam
as_service() { setpriv --reuid uvcam --regid uvcam --init-groups --no-new-privs "$@"; }
as_service uvcam run --config /etc/uvcam/uvcam.toml --duration 10 &
as_service uvcam watch simulated --config /etc/uvcam/uvcam.toml --frames 120 --timeout 8
wait $!
as_service uvcam doctor --config /etc/uvcam/uvcam.toml --json

# Removed, it leaves its configuration; purged, nothing.
apt_get remove uvcam
test ! -e /usr/bin/uvcam
test ! -e /usr/lib/udev/rules.d/70-uvcam.rules
test -f /etc/uvcam/uvcam.toml
apt_get purge uvcam
test ! -e /etc/uvcam
INSIDE

. /etc/os-release
mmdebstrap --quiet --variant=apt --format=null \
    --customize-hook="copy-in '${packages[0]}' '$inside' /" \
    --customize-hook="mv \"\$1\"/uvcam_*.deb \"\$1/uvcam.deb\" && chroot \"\$1\" sh /$(basename "$inside")" \
    "$VERSION_CODENAME" /dev/null
echo "${packages[0]}: installed, flown, removed and purged on a clean ${PRETTY_NAME}"
