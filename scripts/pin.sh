#!/usr/bin/env bash
# Pins requirements.in and requirements-dev.in for every Python from 3.10 on; expects scripts/env.sh
# to have been sourced.
set -euo pipefail

cd "$ROLLER_ROOT"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

compile=("$ROLLER_VENV/bin/uv" pip compile -q --universal --python-version 3.10
  --no-annotate --no-header)
"${compile[@]}" requirements.in -o "$work/run.txt"
"${compile[@]}" -c "$work/run.txt" requirements-dev.in requirements.in -o "$work/all.txt"

{
  echo "# Pinned by \`make requirements\` from requirements.in, for CPython 3.10 and newer."
  cat "$work/run.txt"
} > requirements.txt
{
  echo "# Pinned by \`make requirements\` from requirements-dev.in, on top of requirements.txt."
  grep -vxFf "$work/run.txt" "$work/all.txt"
} > requirements-dev.txt
