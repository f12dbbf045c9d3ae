"""Inspection of a live run from its recording: the points that node `inspect` took, again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader

from roller_core import outputs
from roller_core.bags import typestore
from roller_core.outputs import ContactFault, Output, cloud_of
from roller_inspect.inspect_stage import InspectStage, inspect_parameters
from roller_inspect.judgement import Inspected, judge_nothing
from roller_inspect.recipe import Recipe


def inspect_recorded(bag: Path, recipe: Recipe, part: str, params: Path | None = None) -> Inspected:
    """Inspect the surface that a recorded graph published, as its node `inspect` did.

    Parameters
    ----------
    bag : path
        rosbag2 with `/roller/surface/points`.
    recipe : Recipe
        What the node had.
    part : str
        Name of the part.
    params : path, optional
        The node's parameter file, where it was given any.

    Raises
    ------
    RollerError
        If the points are none of ours.
    """
    stage = InspectStage(inspect_parameters(params, part=part), recipe)
    wanted = {f"/{topic}" for topic in (outputs.SURFACE_POINTS, outputs.CONTACT)}
    store, found = typestore(), []
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic in wanted]
        for connection, _, data in reader.messages(connections):
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp
            t_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
            topic, frame = connection.topic[1:], message.header.frame_id
            if topic == outputs.SURFACE_POINTS:
                stage.take_output(Output(topic, t_ns, frame, cloud_of(message)))
            else:
                for status in message.status:
                    stage.take_output(Output(topic, t_ns, frame, ContactFault(status.message)))
            found += [result.found for result in stage.results()]
        found += [result.found for result in stage.results(flush=True)]
    parts = [part for part in found if isinstance(part, Inspected)]
    return max(
        parts,
        key=lambda p: p.judgement.coverage.area_m2,
        default=judge_nothing(recipe, part),
    )
