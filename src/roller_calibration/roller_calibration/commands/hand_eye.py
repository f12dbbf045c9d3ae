"""`roller calibrate hand-eye`: the camera's place on the tool."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from roller_core.calibration_file import CalibrationError, calibration_record
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.frame_names import BASE_FRAME, TOOL_FRAME
from roller_core.marked_file import SEAL, write_marked_file
from roller_core.progress import progress_bar
from roller_core.text_file import TextFileError, read_text
from roller_core.transforms import F64

from .intrinsics import add_grid_options, grid_of
from .output import add_kind, write

_NUMBERS = 14
#: Places turned by more against each other are two, degrees.
_APART_DEG = 0.005
_PAIRS_MARK = "# pairs of poses, tool in base, then target in camera, by roller calibrate hand-eye"


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    texts = (
        "the camera's place on the tool",
        "The camera's place on the tool, from pairs of poses of the robot and of a target that "
        "stands still: from a recording of the dot grid that `intrinsics` describes, or from a "
        "file; or how the camera is turned, from a scan.",
    )
    parser = add_kind(
        kinds, "hand-eye", run, "emvs; with --scan also ur10, the camera's place so far", texts
    )
    given = parser.add_mutually_exclusive_group(required=True)
    given.add_argument(
        "pairs", type=Path, nargs="?", metavar="FILE",
        help="a pair a line: tool in base, then target in camera, each x y z qx qy qz qw "
        "(metres); # begins a comment",
    )  # fmt: skip
    given.add_argument(
        "--grid-recording", type=Path, metavar="RECORDING",
        help="the robot stands still for 2 s at each of ten poses or more, from which the camera "
        "sees the blinking grid; with --pitch-mm",
    )  # fmt: skip
    given.add_argument(
        "--scan", type=Path, metavar="RECORDING",
        help="a straight pass over a flat plate with texture, level in base: how the camera is "
        "turned; its position on the tool can't be found from it",
    )  # fmt: skip
    add_grid_options(parser)
    parser.add_argument(
        "--pairs", type=Path, dest="pairs_output", metavar="FILE",
        help="with --grid-recording: write the pairs of poses too",
    )  # fmt: skip

    parser.add_argument(
        "--robot-ip", metavar="ADDRESS",
        help="read the tool centre point that the place holds for, and write it too (tcp_offset)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Find the camera's place, print it with its residuals and write it."""
    if args.scan:
        return _from_scan(args)
    if args.grid_recording:
        camera, tools, targets = _from_grid(args)
        return _from_pairs(args, args.grid_recording, camera, tools, targets)
    return _from_pairs(args, args.pairs, None, *_read(args.pairs))


def _from_grid(args: argparse.Namespace) -> tuple[Camera, list[F64], list[F64]]:
    """The camera, and pairs of poses at the views of the grid."""
    from roller_calibration.grid_poses import pairs_of_poses
    from roller_core.parameter_files import read_parameters

    frames = read_parameters(args.params, "emvs")
    path = args.grid_recording

    def on_fault(fault: RollerError) -> None:
        print(f"{path}: {fault}")

    with progress_bar(f"look for the grid in {path.name}") as progress:
        camera, pairs = pairs_of_poses(
            path, grid_of(args), args.camera, args.topic,
            str(frames.get("base_frame", BASE_FRAME)), str(frames.get("moving_frame", TOOL_FRAME)),
            on_fault, progress,
        )  # fmt: skip
    if args.pairs_output:
        rows = [f"{_numbers(tool)} {_numbers(target)}" for tool, target in pairs]
        text = "\n".join([_PAIRS_MARK, "# x y z qx qy qz qw each, metres", f"# {SEAL}", *rows, ""])
        write_marked_file(args.pairs_output, text, _PAIRS_MARK)
    return camera, [tool for tool, _ in pairs], [target for _, target in pairs]


def _numbers(pose: F64) -> str:
    from tf_transformations import quaternion_from_matrix

    return " ".join(f"{v:.9f}" for v in (*pose[:3, 3], *quaternion_from_matrix(pose)))


def _from_pairs(
    args: argparse.Namespace,
    source: Path,
    camera: Camera | None,
    tools: list[F64],
    targets: list[F64],
) -> int:
    from roller_calibration.hand_eye import find_hand_eye

    found = find_hand_eye(tools, targets)
    worst = int(np.argmax(found.residuals_m)) + 1
    residuals = (
        f"residuals of {len(tools)} pairs: {found.rms_m * 1e3:.3f} mm and {found.rms_deg:.3f}° "
        f"rms, {found.residuals_m.max() * 1e3:.3f} mm (pair {worst}) "
        f"and {found.residuals_deg.max():.3f}° at most"
    )
    scale = (
        "the robot's way shows the scale of the target's distances within "
        f"{found.scale_deviation:.2%} (one standard deviation)"
    )
    record = calibration_record(
        "", [source], camera,
        rms_m=found.rms_m, rms_deg=found.rms_deg, scale_deviation=found.scale_deviation,
        pairs=len(tools),
    )  # fmt: skip
    return _finish(args, [_place(found.pose), residuals, scale], found.pose, record)


def _from_scan(args: argparse.Namespace) -> int:
    from roller_calibration.camera_rotation import find_camera_rotation
    from roller_calibration.flat_pass import plate_of
    from roller_calibration.recordings import read_scan
    from roller_core.parameter_files import read_parameters
    from roller_driver.ur10.robot_settings import HandEyeSettings
    from roller_inspect.pipeline import PipelineSettings

    values = read_parameters(args.params, "ur10")
    known = HandEyeSettings.create(
        {k: v for k, v in values.items() if k in HandEyeSettings.model_fields}, str(args.params)
    )
    settings = PipelineSettings.load(args.params).depth
    scan = read_scan(args.scan, args, settings.max_pose_gap_s)
    place = known.hand_eye.matrix if known.hand_eye_known else scan.hand_eye
    if args.output and place is None:
        raise CalibrationError(
            "a scan shows how the camera is turned against the place it was recorded with, and "
            f"{scan.name} doesn't hold that: give it with --params (ur10: hand_eye_m, "
            "hand_eye_quaternion), or leave out --output"
        )
    with progress_bar("turn the camera") as progress:
        found = find_camera_rotation(scan, (settings.depth_min_m, settings.depth_max_m), progress)
    # Relief tells of a turn that there is none of.
    plate_of(found.turned(scan), settings)
    axes = ("about the rows", "about the columns", "about the optical axis")
    each = ", ".join(
        f"{v:+.3f} ± {d:.3f}° {axis}"
        for v, d, axis in zip(found.vector_deg, found.deviation_deg, axes, strict=True)
    )
    lines = [
        f"the camera is turned by {each} against its poses ({found.events} events)",
        "a scan doesn't show the camera's position on the tool, nor a tilt of the plate from one "
        "of the camera",
    ]
    pose = np.eye(4)
    if place is not None:
        pose, notes = _turned_place(place, scan.hand_eye, found.rotation, args.params)
        lines += [*notes, _place(pose)]
    record = calibration_record(
        "", [args.scan], scan.camera,
        turn_deg=found.vector_deg.tolist(), deviation_deg=found.deviation_deg.tolist(),
    )  # fmt: skip
    # Beside the record of the pairs, which its position is from.
    return _finish(args, lines, pose, record, "hand_eye_turn")


def _turned_place(
    place: F64, recorded: F64 | None, rotation: F64, params: Path | None
) -> tuple[F64, list[str]]:
    """The camera's place once it is turned, and what is odd about the one that was given.

    The turn is against the recording's place: beside another it would be taken twice, or not at
    all.
    """
    pose, notes = place.copy(), []
    if recorded is not None:
        apart = Rotation.from_matrix(place[:3, :3].T @ recorded[:3, :3]).magnitude()
        if np.degrees(apart) > _APART_DEG:
            notes.append(
                f"the place in {params} is turned by {np.degrees(apart):.3f}° against the one that "
                "the recording was made with: the turn is taken against the recording's"
            )
        pose[:3, :3] = recorded[:3, :3]
    pose[:3, :3] = pose[:3, :3] @ rotation
    return pose, notes


def _place(pose: F64) -> str:
    from tf_transformations import quaternion_from_matrix

    place = ", ".join(f"{v * 1e3:.3f}" for v in pose[:3, 3])
    turn = ", ".join(f"{v:.6f}" for v in quaternion_from_matrix(pose))
    return f"camera on the tool: {place} mm; x y z w {turn}"


def _finish(
    args: argparse.Namespace,
    lines: list[str],
    pose: F64,
    record: dict[str, Any],
    kind: str = "hand_eye",
) -> int:
    """Print what was found and write it."""
    from tf_transformations import quaternion_from_matrix

    values = {
        "hand_eye_m": [round(float(v), 7) for v in pose[:3, 3]],
        "hand_eye_quaternion": [round(float(v), 9) for v in quaternion_from_matrix(pose)],
        "hand_eye_rotation_rad": [0.0, 0.0, 0.0],
    }
    if args.robot_ip:
        from roller_driver.ur10.rtde import read_tcp_offset

        tool = read_tcp_offset(args.robot_ip)
        if tool is None:
            lines.append(f"robot {args.robot_ip}: its software doesn't tell its tool centre point")
        else:
            values["tcp_offset"] = [round(v, 7) for v in tool]
            lines.append(f"for the tool centre point {', '.join(f'{v:.6g}' for v in tool)}")
    print(*lines, sep="\n")
    write(args, kind, lines, {"ur10": values}, record, "give it to the cell with hand_eye:=")
    return 0


def _read(path: Path) -> tuple[list[F64], list[F64]]:
    """Pairs of 4×4 poses: tool in base, target in camera."""
    from tf_transformations import quaternion_matrix

    try:
        lines = read_text(path).splitlines()
    except TextFileError as error:
        raise CalibrationError(str(error)) from error
    tools: list[F64] = []
    targets: list[F64] = []
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
            pose = quaternion_matrix(part[3:])
            pose[:3, 3] = part[:3]
            out.append(pose)
    return tools, targets
