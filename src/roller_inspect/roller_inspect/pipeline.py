"""Depth, surface and text from one stream: the stages of the graph, without DDS."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from roller_braille.braille_stage import BrailleParameters, BrailleStage
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.event_stage import EventStage
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.outputs import Result
from roller_core.parameter_files import SECTIONS, misspelt_section, read_parameters
from roller_core.pose_track import PoseTrack
from roller_core.stage import Stage
from roller_emvs.depth_stage import DepthStage, EmvsParameters
from roller_emvs.stitcher_stage import StitcherParameters, StitcherStage
from roller_emvs.surface_stage import SurfaceParameters, SurfaceStage

if TYPE_CHECKING:  # what inspects loads scipy
    from .inspect_stage import InspectStage

S = TypeVar("S", EmvsParameters, SurfaceParameters)

#: Settings of the sweep in the surface's frame that the other parts have too.
_SHARED = frozenset(
    {
        "depth_min_m",
        "depth_max_m",
        "average_flats",
        "threads",
        "max_waiting_mb",
        "surface_z_m",
        "event_delay_s",
        "max_pose_gap_s",
        "base_frame",
        "moving_frame",
        "sensor_frame",
    }
)


@dataclass(frozen=True)
class PipelineSettings:
    """Settings of the stages, as their nodes take them."""

    depth: EmvsParameters
    stitcher: StitcherParameters
    braille: BrailleParameters
    surface: SurfaceParameters = field(default_factory=lambda: SurfaceParameters.create({}))

    @classmethod
    def load(cls, path: Path | None = None, method: str | None = None) -> PipelineSettings:
        """Read a ROS 2 parameter file with sections `emvs`, `stitcher`, `braille` and `surface`.

        What `surface` doesn't say of depth range, threads, times, frames and nominal surface,
        `emvs` and `stitcher` say for it; the node `surface` of the live graph has its own section
        alone.

        Parameters
        ----------
        path : path, optional
            Without it all defaults hold.
        method : str, optional
            Goes before the file's `method`.

        Raises
        ------
        SettingsError
            Naming the entry that is wrong.
        """
        depth, stitcher, braille, surface = (
            read_parameters(path, node) for node in ("emvs", "stitcher", "braille", "surface")
        )
        if path and (text := misspelt_section(path, SECTIONS)):
            print(f"warning: {text}", file=sys.stderr)
        source = str(path) if path else "settings"
        if method:
            depth["method"] = method
        shared = {k: v for k, v in {**depth, **stitcher}.items() if k in _SHARED}
        return cls(
            EmvsParameters.create(depth, source),
            StitcherParameters.create(stitcher, source),
            BrailleParameters.create(braille, source),
            SurfaceParameters.create({**shared, **surface}, source),
        )

    def for_inspection(self) -> PipelineSettings:
        """The same with points as they are found: inspection averages them by itself.

        It takes noise for what it is by how it goes with scale, which points that follow their
        neighbours where these agree no longer tell. What was set explicitly stays, as in the graph.
        """

        def as_found(part: S) -> S:
            own = "average_flats" in part.model_fields_set
            return part if own else part.changed({"average_flats": False})

        return replace(self, depth=as_found(self.depth), surface=as_found(self.surface))

    @property
    def sweeps(self) -> bool:
        """Whether the chosen method makes the surface without depth maps."""
        return self.depth.method == "surface"

    @property
    def max_pose_gap_s(self) -> float:
        """Longest time between two poses to interpolate over, of the method that is chosen."""
        return (self.surface if self.sweeps else self.depth).max_pose_gap_s


class Pipeline:
    """The graph's stages, one feeding the other: what live nodes do, in one thread.

    Parameters
    ----------
    settings : PipelineSettings
        Of all stages.
    camera : Camera
        Calibration.
    poses : PoseTrack, optional
        All poses of the camera in base, in place of transforms.
    braille : bool
        Whether to read Braille.
    on_fault : callable, optional
        Called with the reason when input is left out; without it, it is raised.
    inspect : InspectStage, optional
        Takes the points of the surface.

    Raises
    ------
    OtherCameraError
        If the settings are for another camera.
    """

    def __init__(
        self,
        settings: PipelineSettings,
        camera: Camera,
        poses: PoseTrack | None = None,
        braille: bool = True,
        on_fault: Callable[[RollerError], None] | None = None,
        inspect: InspectStage | None = None,
    ) -> None:
        self.settings = settings
        self.depth: DepthStage | SurfaceStage = (
            SurfaceStage(settings.surface) if settings.sweeps else DepthStage(settings.depth)
        )
        self.stitcher = None if settings.sweeps else StitcherStage(settings.stitcher)
        self.braille = BrailleStage(settings.braille) if braille else None
        self.inspect = inspect
        self._on_fault = on_fault
        self._ready: list[Result] = []
        self._of_events: list[EventStage[Any, Any]] = [self.depth]
        if self.braille is not None:
            self._of_events.append(self.braille)
        self.stages: list[Stage[Any]] = [*self._of_events]
        if self.stitcher is not None:
            self.stages.append(self.stitcher)
        if poses is not None:
            for stage in self.stages:
                stage.take_poses(poses)
        for taker in self._of_events:
            taker.take_camera(camera)
        self._newest_ns = 0
        self._least_idle_s = min(stage.settings.idle_flush_s for stage in self._of_events)
        for mapper in (self.depth, self.stitcher):
            if isinstance(mapper, SurfaceStage | StitcherStage):
                mapper.map.period_s = None  # at the end only

    def take_transform(self, transform: Transform) -> None:
        """Take a transform of /tf or /tf_static."""
        said = self._all(self._of_events, lambda stage: stage.take_transform(transform))
        if self.stitcher is not None:
            if self.depth.restarted:
                # While the stitcher still has the poses of the last depth maps.
                self._ready = [*self.results()]
            said |= self._all([self.stitcher], lambda stage: stage.take_transform(transform))
        self._report(said)

    def add_events(self, events: EventArray, renumbered: bool = False) -> None:
        """Take events in order of time, ROS time; `renumbered`: of packets numbered anew."""
        if len(events):
            silence_s = (int(events.t_ns[0]) - self._newest_ns) * 1e-9
            if self._newest_ns and silence_s > self._least_idle_s:
                # As in the graph, whose nodes then process what is left.
                self._ready = [*self.results(silence_s=silence_s)]
                if renumbered:  # there by another process
                    for stage in self._of_events:
                        stage.new_source()
            self._newest_ns = int(events.t_ns[-1])
        self._report(self._all(self._of_events, lambda stage: stage.take_events(events)))

    def take_force(self, t_ns: int, force_n: float) -> None:
        """Take the robot's force of a moment, N."""
        if self.inspect is not None:
            self.inspect.take_force(t_ns, force_n)

    def restart(self) -> None:
        """Restart: the source of the events was started again."""
        for stage in self._of_events:
            stage.restart()

    def results(self, flush: bool = False, silence_s: float = 0.0) -> Iterator[Result]:
        """What is complete by now; with `flush` all that is left.

        After a silence all that is left of those stages that wait no longer (`idle_flush_s`).
        """

        def ends(stage: Stage[Any]) -> bool:
            return flush or silence_s > stage.settings.idle_flush_s

        ready, self._ready = self._ready, []
        yield from ready
        for result in self.depth.results(ends(self.depth)):
            yield from self._inspected(result)
            if self.stitcher is not None and result.outputs:
                for output in result.outputs:
                    if output.topic in self.stitcher.inputs:
                        self.stitcher.take_output(output)
                for stitched in self.stitcher.results():
                    yield from self._inspected(stitched)
        if self.stitcher is not None:
            for stitched in self.stitcher.results(ends(self.stitcher)):
                yield from self._inspected(stitched)
        if self.inspect is not None:
            yield from self.inspect.results(ends(self.inspect))
        if self.braille is not None:
            yield from self.braille.results(ends(self.braille))

    def _inspected(self, result: Result) -> Iterator[Result]:
        """A result, and what the inspection makes of its points."""
        yield result
        if self.inspect is not None:
            for output in result.outputs:
                if output.topic in self.inspect.inputs:
                    self.inspect.take_output(output)
            yield from self.inspect.results()

    def _all(self, stages: Iterable[Any], take: Callable[[Any], None]) -> dict[str, RollerError]:
        """Let stages take something; what several complain of is there once."""
        said: dict[str, RollerError] = {}
        for stage in stages:
            try:
                take(stage)
            except RollerError as error:
                said.setdefault(str(error), error)
        return said

    def _report(self, said: Mapping[str, RollerError]) -> None:
        for error in said.values():
            if self._on_fault is None:
                raise error
            self._on_fault(error)
