#!/usr/bin/env bash
# Pins what each requirements*.in asks for, with hashes, for every Python from 3.10 on. What is
# pinned stays as it is unless UPGRADE=1. Expects scripts/env.sh to have been sourced.
set -euo pipefail

cd "$ROLLER_ROOT"
upgrade=()
if [[ -n "${UPGRADE:-}" ]]; then upgrade=(--upgrade); fi

pin() {
  local name="$1"
  shift
  echo "pinning $name.in"
  "$ROLLER_VENV/bin/uv" pip compile -q --universal --python-version 3.10 --generate-hashes \
    --no-annotate --custom-compile-command "make requirements" "${upgrade[@]}" \
    "$@" "$name.in" -o "$name.txt"
}

pin requirements
# What several ask for is the same in all.
pin requirements-dev -c requirements.txt
pin requirements-colcon -c requirements.txt
pin requirements-browser -c requirements.txt -c requirements-dev.txt
# The wheels are for this platform alone.
pin requirements-ros -c requirements.txt -c requirements-dev.txt
pin requirements-uv
