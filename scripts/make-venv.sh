#!/usr/bin/env bash
# Creates .venv with Python 3.11 or newer and installs this checkout with its development tools into it.
set -euo pipefail
cd "$(dirname "$0")/.."

venv=.venv
# 3.11 first: the pins in constraints/ci.txt were made with it
candidates=(python3.11 python3 python3.12 python3.13)

# Succeeds if the interpreter runs, is new enough and can make virtual environments.
usable() {
  "$1" -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

new_enough() {
  "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
  local name
  for name in "${PYTHON:-}" "${candidates[@]}"; do
    if [ -n "$name" ] && usable "$name"; then
      echo "$name"
      return 0
    fi
  done
  return 1
}

explain_missing() {
  local name
  for name in "${candidates[@]}"; do
    if new_enough "$name"; then
      echo "error: $("$name" -V) is here, but its venv module is not. On Debian or Ubuntu, as root:" >&2
      echo "         apt-get install python3-venv" >&2
      return
    fi
  done
  echo "error: no Python 3.11 or newer was found. Install one, or name it: make PYTHON=/path/to/python3.11 ..." >&2
}

# Debian ships venv apart from Python; root can have it at once.
if ! find_python >/dev/null && new_enough python3 && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
  echo "Installing python3-venv ..."
  apt-get -qq update || true
  DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends python3-venv >/dev/null || true
fi
if ! python=$(find_python); then
  explain_missing
  exit 1
fi

if ! "$venv/bin/python" -c 'import pip' >/dev/null 2>&1; then
  echo "Creating $venv with $("$python" -V) ..."
  "$python" -m venv --clear "$venv"
fi
# twice quiet: errors only
pip() { "$venv/bin/python" -m pip -qq --disable-pip-version-check "$@"; }

echo "Installing into $venv; this takes a few minutes the first time ..."
# torch by itself first, so that nothing that follows can choose another build
pip install -c constraints/ci.txt torch
pip install -c constraints/ci.txt -e '.[dev,docs,examples]'

# sapien asks for opencv-python, whose cv2 folder overwrites that of opencv-python-headless and needs libGL
# (uninstalled, the next pip install of a plugin would bring it back)
pip install --force-reinstall --no-deps -c constraints/ci.txt opencv-python-headless
