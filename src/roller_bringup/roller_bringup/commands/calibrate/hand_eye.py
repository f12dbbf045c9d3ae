"""`roller calibrate hand-eye`: the camera's place on the tool."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

from roller_bringup.calibration_file import CalibrationError, account, write_calibration

_NUMBERS = 14


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        "hand-eye",
        help="the camera's place on the tool",
        description="The camera's place on the tool, from pairs of poses of the robot and of a "
        "target that stands still, such as a board seen without the skin.",
    )
    parser.add_argument(
        "poses", type=Path, metavar="FILE",
        help="a pair a line: tool in base, then target in camera, each x y z qx qy qz qw "
        "(metres); # begins a comment",
    )  # fmt: skip
    parser.add_argument(
        "--output", "-o", type=Path, metavar="FILE", help="parameter file to write for the robot"
    )
    parser.add_argument("--params", type=Path, metavar="FILE", help="file to carry over")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Find the camera's place, print it with its residuals and write it.

    Raises
    ------
    RollerError
        If the file can't be read or its poses tell nothing.
    """
    from roller_emvs.calibration import find_hand_eye

    tools, targets = _read(args.poses)
    found = find_hand_eye(tools, targets)
    place = ", ".join(f"{v * 1e3:.3f}" for v in found.position_m)
    turn = ", ".join(f"{v:.6f}" for v in found.quaternion)
    worst = int(np.argmax(found.residuals_m)) + 1
    told = [
        f"camera on the tool: {place} mm; x y z w {turn}",
        f"residuals of {len(tools)} pairs: {found.rms_m * 1e3:.3f} mm and {found.rms_deg:.3f}° "
        f"rms, {found.residuals_m.max() * 1e3:.3f} mm (pair {worst}) "
        f"and {found.residuals_deg.max():.3f}° at most",
    ]
    for line in told:
        print(line)
    if args.output:
        values = {
            "hand_eye_m": [round(float(v), 7) for v in found.position_m],
            "hand_eye_quaternion": [round(float(v), 9) for v in found.quaternion],
        }
        record = account(
            "", [args.poses], None, rms_m=found.rms_m, rms_deg=found.rms_deg, pairs=len(tools)
        )
        write_calibration(args.output, "hand_eye", told, {"ur10": values}, record, args.params)
        print(f"written to {args.output}; give it to the cell with hand_eye:=")
    return 0


def _read(path: Path) -> tuple[list[npt.NDArray[np.float64]], list[npt.NDArray[np.float64]]]:
    """Pairs of 4×4 poses: tool in base, target in camera."""
    from roller_core.transforms import pose_matrix, unit_quaternion

    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: can't be read ({error})") from error
    tools: list[npt.NDArray[np.float64]] = []
    targets: list[npt.NDArray[np.float64]] = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            values = np.array([float(word) for word in words])
        except ValueError as error:
            raise CalibrationError(f"{path}, line {number}: {error}") from error
        if len(values) != _NUMBERS or not np.isfinite(values).all():
            raise CalibrationError(
                f"{path}, line {number}: expected {_NUMBERS} numbers, tool in base and target in "
                f"camera as x y z qx qy qz qw each, not {len(values)}"
            )
        for part, out in ((values[:7], tools), (values[7:], targets)):
            length = float(np.linalg.norm(part[3:]))
            if not 0.99 < length < 1.01:
                raise CalibrationError(
                    f"{path}, line {number}: a quaternion has length {length:.3g}, not 1"
                )
            out.append(pose_matrix(part[:3], unit_quaternion(part[3:])))
    return tools, targets
