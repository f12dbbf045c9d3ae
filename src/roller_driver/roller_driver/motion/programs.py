"""The pass as URScript and as a joint trajectory for ros2_control."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from roller_core.transforms import F64, inverse_pose

from .kinematics import JOINTS, MOST_RAD, MOST_RAD_S, SHARE, Arm, KinematicsError
from .rolling_pass import REACH_M, RollingPass

WARNING = """\
# EXAMPLE. It moves a robot. The risk assessment of the cell is the integrator's: speeds, forces,
# safety planes, reach and the stop distance on your robot, with your tool. Try it first without
# the roller, at a tenth of the speed, with a hand on the emergency stop."""
#: How a script begins: it is sent as it is, so with its function.
SCRIPT_HEAD = "\n".join(["def roll_pass():", *(f"  {line}" for line in WARNING.splitlines())])
#: Speeds and accelerations of approach and retreat.
_APPROACH = "a=0.3, v=0.05"
#: Times of a trajectory's points lie this far apart, seconds.
STEP_S = 0.02


def urscript(rolling: RollingPass) -> str:
    """A URScript program of the pass.

    It can be sent to the controller as it is (port 30002), which runs the function it begins with;
    a program on the pendant that loads it calls `roll_pass()`.

    The ramps are straight continuations of the pass: the roller must touch nothing there, or a
    run-in plate that is level with the part. Pressing with a force begins on the run-in plate.

    Raises
    ------
    KinematicsError
        If the ramps reach further than any arm.
    """
    before, after = rolling.ends_m
    if (away_m := max(np.linalg.norm(p) for p in (before, after))) > REACH_M:
        raise KinematicsError(
            f"ramps of {rolling.ramp_m * 1e3:.0f} mm lead to {away_m:.3g} m from the robot's base: "
            f"it reaches {REACH_M} m at most; accelerate harder, or slow the pass down"
        )
    up = np.array([0.0, 0.0, rolling.lift_m])
    v, a = rolling.speed_m_s, rolling.acceleration_m_s2
    lines = [
        SCRIPT_HEAD,
        f"  # {rolling.length_m * 1e3:.0f} mm at {v:g} m/s, ramps of {rolling.ramp_m * 1e3:.0f} mm "
        "before and behind it.",
        "  # Sent to the controller (port 30002) this runs at once. A program on the pendant that",
        "  # loads it as a script file calls roll_pass() in the line after.",
        f"  movel({_pose(before + up, rolling)}, {_APPROACH})",
        f"  movel({_pose(before, rolling)}, {_APPROACH})",
    ]
    if rolling.force_n:
        lines += [
            "  sleep(0.2)",
            "  zero_ftsensor()  # e-series; on a CB3 leave it out",
            "  # Compliant along base z alone; elsewhere the path is held within 5 mm.",
            "  force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], "
            f"[0,0,{-rolling.force_n:g},0,0,0], 2, [0.005,0.005,0.02,0.05,0.05,0.05])",
            "  sleep(0.5)",
        ]
    lines.append(f"  movel({_pose(after, rolling)}, a={a:g}, v={v:g})")
    if rolling.force_n:
        lines.append("  end_force_mode()")
    lines += [f"  movel({_pose(after + up, rolling)}, {_APPROACH})", "end", ""]
    return "\n".join(lines)


def _pose(position_m: F64, rolling: RollingPass) -> str:
    return "p[" + ", ".join(f"{v:.6f}" for v in (*position_m, *rolling.rotation_rad)) + "]"


def joint_trajectory(rolling: RollingPass, arm: Arm, near_rad: F64, tcp: F64) -> dict[str, Any]:
    """The pass as a goal of `control_msgs/action/FollowJointTrajectory`.

    Parameters
    ----------
    rolling : RollingPass
        What to do; the height is held, no force is.
    arm : Arm
        Which robot.
    near_rad : ndarray, shape (6,)
        Joints near the beginning: they choose the posture.
    tcp : ndarray, shape (4, 4)
        Tool centre point on the flange, metres.

    Raises
    ------
    KinematicsError
        If the arm doesn't reach the line, passes a singularity, or a joint would have to turn
        further than it can, or faster than half of its limit.
    """
    t_s = np.linspace(0, rolling.duration_s, int(np.ceil(rolling.duration_s / STEP_S)) + 1)
    rotation = Rotation.from_rotvec(rolling.rotation_rad).as_matrix()
    off_flange, q, joints = inverse_pose(tcp), np.array(near_rad, float), []
    for position in rolling.positions_m(t_s):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, position
        q = arm.joints(pose @ off_flange, q)
        joints.append(q)
    path = np.array(joints)
    if (furthest := np.abs(path).max(axis=0)).max() > MOST_RAD:
        worst = int(np.argmax(furthest))
        raise KinematicsError(
            f"{JOINTS[worst]} would turn to {np.degrees(furthest[worst]):.0f}°, more than "
            f"{np.degrees(MOST_RAD):.0f}°: start from another posture"
        )
    speed = np.gradient(path, t_s, axis=0, edge_order=2)
    share = np.abs(speed).max(axis=0) / (SHARE * MOST_RAD_S)
    if share.max() > 1:
        worst = int(np.argmax(share))
        raise KinematicsError(
            f"{JOINTS[worst]} would turn at {np.degrees(np.abs(speed[:, worst]).max()):.0f}°/s, "
            f"more than half of its limit: slow the pass down, or start from another posture"
        )
    speed[[0, -1]] = 0.0
    points = [
        {
            "positions": [round(float(v), 8) for v in row],
            "velocities": [round(float(v), 8) for v in rate],
            "time_from_start": {"sec": int(t), "nanosec": int((t % 1) * 1e9)},
        }
        for t, row, rate in zip(t_s, path, speed, strict=True)
    ]
    return {"trajectory": {"joint_names": list(JOINTS), "points": points}}
