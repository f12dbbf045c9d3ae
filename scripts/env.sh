# Sourced by ./roller and the Makefile's targets: the environment everything runs in.
# Expects ROLLER_ROOT, the workspace's root.

ROLLER_VENV="$ROLLER_ROOT/.venv"
if [[ ! -s "$ROLLER_VENV/setup/mode" ]]; then
  echo "${ROLLER_NAME:-roller}: not set up yet: run \`make setup\` in $ROLLER_ROOT" >&2
  exit 1
fi
ROLLER_MODE="$(<"$ROLLER_VENV/setup/mode")"
export ROLLER_ROOT ROLLER_VENV ROLLER_MODE

# After `git pull` commands or libraries can be missing, in words that don't say why.
for roller_file in "$ROLLER_ROOT"/requirements*.txt "$ROLLER_ROOT"/src/*/{setup.py,package.xml,msg/*}; do
  if [[ "$roller_file" -nt "$ROLLER_VENV/setup/mode" ]]; then
    echo "${ROLLER_NAME:-roller}: the workspace has changed since it was set up: run \`make setup\`" >&2
    break
  fi
done
unset roller_file

# Left behind by a Python of another environment, it would keep ours from finding its libraries.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE

if [[ "$ROLLER_MODE" == distribution ]]; then
  roller_nounset="$(shopt -po nounset || true)"
  set +u
  # shellcheck source=/dev/null
  source "$ROLLER_ROOT/install/setup.bash"
  eval "$roller_nounset"
elif [[ -n "${AMENT_PREFIX_PATH:-}" ]]; then
  # A distribution is sourced that this workspace wasn't set up on: keep its packages out.
  unset AMENT_PREFIX_PATH PYTHONPATH LD_LIBRARY_PATH
fi

# Nothing leaves this machine unless a cell says so: ROLLER_ROS_NETWORK=SUBNET, or ROS 2's own
# variable.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-${ROLLER_ROS_NETWORK:-LOCALHOST}}"

# Without this profile Fast DDS loses messages above half a megabyte, such as depth images.
export FASTDDS_DEFAULT_PROFILES_FILE="${FASTDDS_DEFAULT_PROFILES_FILE:-$ROLLER_ROOT/config/fastdds.xml}"

# ROS 2 keeps its logs in HOME; some services and containers have none.
if [[ -z "${ROS_LOG_DIR:-}" && ! -w "${ROS_HOME:-${HOME:-/nonexistent}}" ]]; then
  export ROS_LOG_DIR="$ROLLER_ROOT/log/ros"
fi

# Compiled kernels and bytecode stay out of the source tree. Without bytecode every process would
# compile its libraries again, which takes seconds.
if [[ -w "$ROLLER_VENV" ]]; then
  export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$ROLLER_VENV/cache/numba}"
  unset PYTHONDONTWRITEBYTECODE
  export PYTHONPYCACHEPREFIX="${PYTHONPYCACHEPREFIX:-$ROLLER_VENV/cache/bytecode}"
fi
