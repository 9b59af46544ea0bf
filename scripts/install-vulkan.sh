#!/usr/bin/env bash
# Install a software Vulkan renderer (Mesa lavapipe) that SAPIEN can use; needed for 3-D pictures only.
#
#   scripts/install-vulkan.sh            uses .venv/bin/python, or $PYTHON, to ask SAPIEN what it can use
#
# Does nothing where SAPIEN already finds a device. Where it cannot help it prints what to type. Always exits 0:
# everything but the pictures works without Vulkan.
set -uo pipefail

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
python="${PYTHON:-$root/.venv/bin/python}"
sources_dir=/etc/apt/sources.list.d

say() { printf 'vulkan: %s\n' "$*"; }

works() { [ -x "$python" ] && "$python" -m hpp_framework.sim.sapien_render >/dev/null 2>&1; }

# The first mirror that this machine's own apt sources use for main packages, so that no host is named here.
mirror() {
  local deb822 one_line
  deb822="$(cat "$sources_dir"/*.sources 2>/dev/null | awk '
    function flush() { if (uri != "" && suites ~ /(^| )bookworm( |$)/) { print uri; done = 1; exit } uri = ""; suites = "" }
    /^[ \t]*$/ { flush(); next }
    /^URIs:/ { uri = $2 }
    /^Suites:/ { $1 = ""; suites = $0 }
    END { if (!done && uri != "" && suites ~ /(^| )bookworm( |$)/) print uri }')"
  if [ -n "$deb822" ]; then printf '%s\n' "$deb822"; return; fi
  one_line="$(cat /etc/apt/sources.list "$sources_dir"/*.list 2>/dev/null | sed -E 's/^deb[[:space:]]+\[[^]]*\]/deb/' |
    awk '$1 == "deb" && $3 == "bookworm" { print $2; exit }')"
  printf '%s\n' "$one_line"
}

has_backports() {
  grep -qsE '^[^#]*bookworm-backports' /etc/apt/sources.list "$sources_dir"/*.list "$sources_dir"/*.sources
}

add_backports() {
  local uri keyring
  uri="$(mirror)"
  if [ -z "$uri" ]; then
    say "no bookworm mirror in the apt sources; add bookworm-backports yourself, then run this again."
    return 1
  fi
  keyring=/usr/share/keyrings/debian-archive-keyring.gpg
  {
    printf 'Types: deb\nURIs: %s\nSuites: bookworm-backports\nComponents: main\n' "$uri"
    if [ -f "$keyring" ]; then printf 'Signed-By: %s\n' "$keyring"; fi
  } >"$sources_dir/bookworm-backports.sources"
  say "added $sources_dir/bookworm-backports.sources"
}

install_packages() {
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -qq && apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

if works; then
  say "SAPIEN finds a usable device; nothing to do."
  exit 0
fi

id="" version=""
if [ -r /etc/os-release ]; then
  # shellcheck disable=SC1091
  . /etc/os-release
  id="${ID:-}" version="${VERSION_ID:-}"
fi

case "$id" in
  debian | ubuntu) ;;
  *)
    say "this is not Debian or Ubuntu. Install your system's Mesa Vulkan drivers (lavapipe, Mesa 25 or newer)"
    say "and the Vulkan loader, or run in a container of Debian 12."
    exit 0
    ;;
esac

if [ "$(id -u)" != 0 ]; then
  say "SAPIEN finds no usable Vulkan device. To install the software renderer, type:"
  say "  sudo PYTHON='$python' '$root/scripts/install-vulkan.sh'"
  exit 0
fi

packages=(mesa-vulkan-drivers libvulkan1)
if [ "$id" = debian ] && [ "$version" = 12 ]; then
  # the plain bookworm driver (22.3) is too old for SAPIEN 3
  if ! has_backports && ! add_backports; then exit 0; fi
  packages=(-t bookworm-backports "${packages[@]}")
fi

say "installing ${packages[*]}"
if ! install_packages "${packages[@]}"; then
  say "apt-get failed; check the network and run this again. Everything but 3-D pictures works without it."
  exit 0
fi

if [ ! -x "$python" ] || works; then
  say "done."
else
  say "installed, but SAPIEN still finds no usable device; '$python -m hpp_framework.sim.sapien_render' says why."
fi
