#!/usr/bin/env bash
# Find the drift of edges under a light of the virtual cell, ring or strong, on its gauges, none of
# which is among the objects that it is judged on, as on any instrument; writes
# config/virtual_cell_LIGHT.yaml. Three recordings of each gauge at each speed, as what one tells
# hangs on vibration and noise. Four minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
light=${1:-ring}
case "$light" in
  ring) cell=() fast=0.5 ;;
  strong) # its pixels are blind for longer
    fast=0.25
    cell=(--set light.kind=strong --set sensor.threshold=0.25 --set sensor.bandwidth_hz=4000
      --set sensor.refractory_us=500 --set sensor.background_hz=0.1) ;;
  *) echo "usage: $0 [ring|strong]" >&2; exit 2 ;;
esac
scans=$(mktemp -d)
trap 'rm -rf "$scans"' EXIT
delay="$scans/delay.yaml"
for speed in 0.1 $fast; do
  ./roller simulate "${cell[@]}" flat --coating textured --speed "$speed" --set motion.reverse=true --output "$scans/to_and_fro_$speed"
done
./roller calibrate time-offset "$scans/to_and_fro_0.1" "$scans/to_and_fro_$fast" \
  --output "$scans/time_offset.yaml"
late=$(awk '/event_delay_s:/ {print $2; exit}' "$scans/time_offset.yaml")
printf '/**/%s:\n  ros__parameters:\n    event_delay_s: %s\n' emvs "$late" surface "$late" > "$delay"
found=()
for speed in 0.1 0.3 0.5; do
  for seed in 1 2 3; do
    sphere="$scans/sphere_${speed}_$seed" steps="$scans/steps_${speed}_$seed"
    ./roller simulate "${cell[@]}" gauge_sphere --speed "$speed" --seed "$seed" --set motion.reverse=true --output "$sphere"
    ./roller simulate "${cell[@]}" gauge_steps --speed "$speed" --seed "$seed" --set motion.reverse=true --output "$steps"
    found+=(--sphere "$sphere" --steps "$steps")
  done
done
./roller calibrate edge-drift "${found[@]}" --radius-mm 5 --step-mm 0.25 --params "$delay" \
  --output "$scans/found.yaml"
# Light and sensor matter, not the camera's geometry, which users of the virtual cell change; nor
# is the delay taken out of its scans by default.
sed -e "/as written: sha256/d" -e "/^    event_delay_s:/d" -e "/^    calibrated_camera:/d" -e "/^    - /d" \
  "$scans/found.yaml" > "config/virtual_cell_$light.yaml"
