"""`roller motion`: an example of how to roll, for the robot's own controller."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.errors import RollerError

_TEXT = """\
Write an example of a pass at one speed: a straight line with ramps off the part, as URScript
(with --force-n pressed by force mode) and as a joint trajectory for the ROS 2 driver's
scaled_joint_trajectory_controller. It moves nothing itself. It is an example: the risk assessment
of the cell is the integrator's."""
_EXAMPLES = """\
examples:
  roller motion --start-m 0.50 -0.20 0.12 --end-m 0.80 -0.20 0.12 --speed 0.3 --script pass.script
  roller motion --start-m 0.50 -0.20 0.12 --end-m 0.80 -0.20 0.12 --trajectory pass.yaml \\
      --joints-deg 130 -100 140 -130 -90 220 --tcp-m 0 0 0.15
  ros2 topic pub --once /urscript_interface/script_command std_msgs/msg/String \\
      "$(python3 -c 'import json; print(json.dumps({"data": open("pass.script").read()}))')"
  ros2 action send_goal /scaled_joint_trajectory_controller/follow_joint_trajectory \\
      control_msgs/action/FollowJointTrajectory "$(cat pass.yaml)\""""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `motion` to the command's parser."""
    parser = subparsers.add_parser(
        "motion",
        help="an example of how to roll: URScript, joint trajectory",
        description=_TEXT,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, text in (("start", "speed is reached"), ("end", "speed is held until")):
        parser.add_argument(
            f"--{name}-m", type=float, nargs=3, required=True, metavar=("X", "Y", "Z"),
            help=f"tool centre point in base where {text}, m",
        )  # fmt: skip
    parser.add_argument(
        "--rotation-rad", type=float, nargs=3, metavar=("RX", "RY", "RZ"),
        help="rotation vector of the tool, as the pendant shows it (default: straight down)",
    )  # fmt: skip
    parser.add_argument("--speed", type=float, metavar="M/S", help="up to 0.5 (default: 0.1)")
    parser.add_argument(
        "--acceleration", type=float, metavar="M/S2", help="of the ramps (default: 1)"
    )
    parser.add_argument("--force-n", type=float, metavar="N", help="URScript: press by force mode")
    parser.add_argument(
        "--lift-m",
        type=float,
        metavar="M",
        help="URScript: height of approach and retreat (default: 0.05)",
    )
    parser.add_argument("--script", type=Path, metavar="FILE", help="URScript to write")
    parser.add_argument("--trajectory", type=Path, metavar="FILE", help="joint trajectory to write")
    parser.add_argument(
        "--joints-deg", type=float, nargs=6, metavar="Q", help="trajectory: joints near the start"
    )
    parser.add_argument(
        "--tcp-m", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"),
        help="trajectory: tool centre point on the flange, m",
    )  # fmt: skip
    parser.add_argument(
        "--arm", choices=("ur10", "ur10e"), default="ur10", help="trajectory: the arm (ur10)"
    )
    parser.set_defaults(run=run)


class MotionError(RollerError):
    """Options of `roller motion` that don't go together."""


def run(args: argparse.Namespace) -> int:
    """Write the programs that are asked for."""
    import numpy as np
    import yaml

    from roller_core.marked_file import SEAL, write_marked_file
    from roller_driver.motion.kinematics import ARMS
    from roller_driver.motion.programs import SCRIPT_HEAD, WARNING, joint_trajectory, urscript
    from roller_driver.motion.rolling_pass import RollingPass

    if not (args.script or args.trajectory):
        raise MotionError("give --script FILE, --trajectory FILE, or both")
    if args.trajectory and not args.joints_deg:
        raise MotionError("--trajectory needs --joints-deg: they choose the arm's posture")
    if args.trajectory and args.force_n:
        raise MotionError("a joint trajectory holds the height; --force-n goes with --script alone")
    if not np.isfinite([*(args.joints_deg or ()), *args.tcp_m]).all():
        raise MotionError("--joints-deg and --tcp-m must be finite")
    given = {
        "start_m": args.start_m, "end_m": args.end_m, "rotation_rad": args.rotation_rad,
        "speed_m_s": args.speed, "acceleration_m_s2": args.acceleration,
        "force_n": args.force_n, "lift_m": args.lift_m,
    }  # fmt: skip
    rolling = RollingPass.create({k: v for k, v in given.items() if v is not None}, "the pass")
    print(
        f"{rolling.length_m * 1e3:.0f} mm at {rolling.speed_m_s:g} m/s; ramps of "
        f"{rolling.ramp_m * 1e3:.0f} mm must be free before and behind it; "
        f"{rolling.duration_s:.1f} s"
    )
    if args.script:
        body = urscript(rolling).removeprefix(SCRIPT_HEAD)
        write_marked_file(args.script, f"{SCRIPT_HEAD}\n  # {SEAL}{body}", SCRIPT_HEAD)
        print(f"written to {args.script}")
    if args.trajectory:
        tcp = np.eye(4)
        tcp[:3, 3] = args.tcp_m
        goal = joint_trajectory(rolling, ARMS[args.arm], np.radians(args.joints_deg), tcp)
        first = np.degrees(goal["trajectory"]["points"][0]["positions"])
        place = "the arm must stand here when it starts: " + ", ".join(f"{q:.1f}°" for q in first)
        text = yaml.safe_dump(goal, sort_keys=False, default_flow_style=None, width=200)
        text = f"{WARNING}\n# {SEAL}\n# Joints: {place}\n{text}"
        write_marked_file(args.trajectory, text, WARNING)
        print(f"written to {args.trajectory}; {place}")
    return 0
