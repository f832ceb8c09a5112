#!/bin/sh
# Installs what Python packages cannot carry, where it is missing and Debian's tools are at hand.
# Usage: system-libraries.sh PYTHON [--dev]
set -eu

python=$1
role=${2:-}
open3d="libgl1 libx11-6 libgomp1 libegl1 libusb-1.0-0"   # import open3d
browser="chromium chromium-driver"                       # --dev: the tests that press the pages' buttons
viewer="mesa-vulkan-drivers libvulkan1"                  # --dev: the Rerun viewer without a display (vfoa view --screenshot)

sudo=""
updated=""
if [ "$(id -u)" -ne 0 ] && command -v sudo >/dev/null; then sudo="sudo"; fi

# Install these packages with apt; true where there is no apt, or no right to use it: what needs them says so then.
install() {
    command -v apt-get >/dev/null && { [ "$(id -u)" -eq 0 ] || [ -n "$sudo" ]; } || return 0
    echo "installing system libraries: $*"
    [ -n "$updated" ] || $sudo apt-get update -qq
    updated=yes
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# The same, of what some tests alone need: another system, such as Ubuntu, may not have a package.
install_for_tests() {
    install "$@" || echo "could not be installed: $*: the tests that need them are skipped" >&2
}

# shellcheck disable=SC2086  # lists of packages
{
    "$python" -c 'import open3d' >/dev/null 2>&1 || install $open3d
    if [ "$role" = --dev ]; then
        ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' || install_for_tests $viewer
        { command -v chromium || command -v google-chrome; } >/dev/null && command -v chromedriver >/dev/null ||
            install_for_tests $browser
    fi
}

if ! "$python" -c 'import open3d'; then
    echo "open3d needs these system libraries (Debian's names): $open3d" >&2
    exit 1
fi
