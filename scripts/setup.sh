#!/bin/sh
# Installs what the build and the program need and this machine lacks: on Debian and Ubuntu by apt, as root or by
# sudo; elsewhere it says what to install. Installs nothing where nothing is missing, and never asks.
# Usage: setup.sh [test]   with `test`, also what the checks need.
set -eu
packages=""
need() { # package, reason
    echo "setup: $1 is missing: $2"
    packages="$packages $1"
}
has_library() {
    { ldconfig -p 2>/dev/null || /sbin/ldconfig -p 2>/dev/null; } | grep -q "$1"
}

if ! command -v cargo >/dev/null 2>&1; then
    echo "setup: no cargo on the PATH; install Rust 1.95 or later from https://rustup.rs, then run this again" >&2
    exit 1
fi

# Rust links with the C compiler; METIS (nested dissection) and BLAKE3 are compiled by it.
command -v cc >/dev/null 2>&1 || need gcc "Rust links with it, and METIS is compiled by it"
[ -e /usr/include/stdlib.h ] || need libc6-dev "the C library's headers"

# The feature `audio`, which is built by default, links with ALSA.
command -v pkg-config >/dev/null 2>&1 || need pkg-config "the build finds ALSA by it"
[ -e /usr/include/alsa/asoundlib.h ] || need libasound2-dev "sound is played by ALSA; \`--no-default-features\` builds without"

# A Vulkan driver: a real GPU's is left alone, whatever it is.
drivers=$(ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json /usr/local/share/vulkan/icd.d/*.json \
    /usr/local/*/share/vulkan/icd.d/*.json 2>/dev/null || true)
if [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}$drivers" ]; then
    has_library libvulkan.so.1 || need libvulkan1 "the Vulkan loader; a driver is there"
elif [ -e /dev/nvidia0 ] || [ -e /dev/dxg ]; then
    echo "setup: this machine has a GPU, but its driver brings no Vulkan; it is left alone, and pictures are drawn on" \
        "the processor until the driver's Vulkan part is installed" >&2
    need mesa-vulkan-drivers "drawing on the processor meanwhile"
else
    need mesa-vulkan-drivers "no Vulkan driver: Mesa draws on a GPU it knows, and on the processor where there is none"
fi

# The tests of windows start an X server of their own.
if [ "${1:-}" = test ]; then
    command -v Xvfb >/dev/null 2>&1 || need xvfb "the tests of windows start an X server without a monitor"
fi

# Windows, where there is a display.
if [ -n "${DISPLAY:-}" ] || [ "${1:-}" = test ]; then
    has_library libxkbcommon-x11.so.0 || need libxkbcommon-x11-0 "keyboard input in X11 windows"
    has_library libXcursor.so.1 || need libxcursor1 "the cursor in X11 windows"
    has_library libXi.so.6 || need libxi6 "mouse input in X11 windows"
fi

if [ -n "$packages" ]; then
    if ! command -v apt-get >/dev/null 2>&1; then
        echo "setup: this is not Debian or Ubuntu; install what your system calls:$packages" >&2
        exit 1
    fi
    if [ "$(id -u)" = 0 ]; then
        root=""
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        root="sudo"
    else
        echo "setup: neither root nor sudo without a password; run: apt-get install$packages" >&2
        exit 1
    fi
    echo "setup: installing$packages"
    $root apt-get update -qq
    # shellcheck disable=SC2086
    $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages >/dev/null
fi

if [ "${1:-}" = test ]; then
    for tool in rustfmt clippy; do
        if ! cargo "$(echo $tool | sed s/rust//)" --version >/dev/null 2>&1; then
            echo "setup: $tool is missing: the checks need it; adding it by rustup"
            rustup component add "$tool"
        fi
    done
fi
