#!/bin/sh
# Installs what Python packages cannot carry, where it is missing and Debian's tools are at hand.
# Usage: system-libraries.sh PYTHON [--dev]
set -eu

python=$1
role=${2:-}
open3d="libgl1 libx11-6 libgomp1 libegl1 libusb-1.0-0"   # import open3d
browser="chromium chromium-driver"                       # --dev: the tests that press the pages' buttons
viewer="mesa-vulkan-drivers libvulkan1"                  # --dev: the Rerun viewer without a display (vfoa view --screenshot)

missing=""
"$python" -c 'import open3d' >/dev/null 2>&1 || missing="$open3d"
if [ "$role" = --dev ]; then
    ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' || missing="$missing $viewer"
    { command -v chromium && command -v chromedriver; } >/dev/null || missing="$missing $browser"
fi
[ -n "$missing" ] || exit 0

sudo=""
if [ "$(id -u)" -ne 0 ] && command -v sudo >/dev/null; then sudo="sudo"; fi
if command -v apt-get >/dev/null && { [ "$(id -u)" -eq 0 ] || [ -n "$sudo" ]; }; then
    echo "installing system libraries: $missing"
    $sudo apt-get update -qq
    # shellcheck disable=SC2086  # a list of packages
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends $missing >/dev/null
fi

if ! "$python" -c 'import open3d'; then
    echo "open3d needs these system libraries (Debian's names): $open3d" >&2
    exit 1
fi
