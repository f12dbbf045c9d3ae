#!/usr/bin/env bash
# `make setup`: picks the Python the workspace is built on and hands over to scripts/workspace.
# ROLLER_PYTHON names that Python; ROLLER_ROS=wheels ignores a sourced ROS 2 distribution.
set -euo pipefail

root="$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)"
cd "$root"

# Set up on a ROS distribution before, in a shell that hasn't sourced it now: source it.
distribution=.venv/setup/distribution
if [[ "${ROLLER_ROS:-}" != wheels && -z "${AMENT_PREFIX_PATH:-}" && -s "$distribution" ]]; then
  prefix="$(<"$distribution")"
  if [[ -f "$prefix/setup.bash" ]]; then
    set +u
    # shellcheck source=/dev/null
    source "$prefix/setup.bash"
    set -u
  fi
fi

for python in "${ROLLER_PYTHON:-python3}" python3.13 python3.12 python3.11 python3.10 python3.14; do
  if command -v "$python" >/dev/null &&
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
    exec env PYTHONDONTWRITEBYTECODE=1 "$python" scripts/workspace "$@"
  fi
  if [[ -n "${ROLLER_PYTHON:-}" ]]; then
    echo "setup: ROLLER_PYTHON=$ROLLER_PYTHON is not a Python 3.10 or newer" >&2
    exit 1
  fi
done
echo "setup: needs Python 3.10 or newer: sudo apt install python3 python3-venv python3-dev" >&2
exit 1
