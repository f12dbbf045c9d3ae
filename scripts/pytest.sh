#!/usr/bin/env bash
# Runs pytest as the Makefile does; expects scripts/env.sh to have been sourced.
set -euo pipefail

cd "$ROLLER_ROOT"

# Only the plugins we pin: others on the machine (dash brings one, ROS 2's launch another) may not
# suit our pytest.
export PYTEST_DISABLE_PLUGIN_AUTOLOAD=1
# As the command and the nodes do: libraries' own threads wait for each other on busy cores.
export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
export OPENCV_FOR_THREADS_NUM="${OPENCV_FOR_THREADS_NUM:-1}"
# With worksteal each process takes a run of neighbours, so that they share what a module sets up.
options=(-q -p xdist -p pytest_timeout -p _hypothesis_pytestplugin --dist worksteal)
if [[ -n "${CI:-}" ]]; then options+=(--durations=20); fi

exec "$ROLLER_VENV/bin/python" -m pytest "${options[@]}" "$@"
