#!/usr/bin/env bash
# Runs pytest as the Makefile does; expects scripts/env.sh to have been sourced.
set -euo pipefail

cd "$ROLLER_ROOT"

# Only the plugins we pin: others on the machine (dash brings one, ROS 2's launch another) may not
# suit our pytest.
export PYTEST_DISABLE_PLUGIN_AUTOLOAD=1
plugins=(-p xdist -p pytest_timeout -p _hypothesis_pytestplugin)

code=0
"$ROLLER_VENV/bin/python" -m pytest "${plugins[@]}" "$@" || code=$?
# 5: nothing selected, which is fine when the tests are run in parts.
[[ $code == 5 ]] && code=0
exit "$code"
