"""What node `inspect` does: points of the surface in, findings and a verdict out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from pydantic import Field

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.frame_settings import FollowedFrames, idle_flush_field
from roller_core.outputs import Cloud, Output, Result, ScanFault
from roller_core.parameter_files import read_parameters
from roller_core.stage import ERROR, OK, Stage
from roller_emvs.patch import Patch

from .covered_area import coverage_of_area
from .findings import CellUncertainty, Finding
from .form import damaged_all_over, goes_on_in_gap, off_reference
from .height_map import CONTINUED, MEASURED, OUTSIDE
from .height_map.coverage import Coverage
from .judgement import Inspected, Judged, Judgement, judge, judge_findings
from .measures import measure_all
from .part_points import PartPoints
from .pieces import Piece
from .recipe import Recipe, load_recipe, load_reference
from .recipe.decision import Verdict
from .references import SelfReference
from .revisits import Revisits
from .scan_faults import ScanFaults
from .surface_inspector import SurfaceInspector

DEVIATION_FIELDS = ("x", "y", "z", "deviation", "sigma", "state")
#: Points this much older are of a source that started again, s.
_RESTART_S = 1.0


class InspectParameters(FollowedFrames):
    """Parameters of the node."""

    recipe: str = Field("", description="The recipe, a YAML file; empty: the default recipe.")
    part: str = Field("", description="Name of the parts; each gets a number after it.")
    uncertainty: CellUncertainty = Field(
        CellUncertainty.create({}), description="What the cell adds to that of figures."
    )
    idle_flush_s: float = idle_flush_field(2.0, "points for this long the part is finished")


def inspect_parameters(params: Path | None, **own: str) -> InspectParameters:
    """Parameters of the node from a parameter file, and on top of them some of its own."""
    found = read_parameters(params, "inspect")
    return InspectParameters.create(found | own, str(params or "settings"))


@dataclass(frozen=True)
class FindingList:
    """All that is known of a part."""

    #: Counts up with every change, from 1 with each part.
    revision: int
    #: Whether the part is.
    finished: bool
    #: Its name.
    part: str
    #: Verdict, findings, coverage.
    judgement: Judgement


@dataclass(frozen=True)
class FindingMarkers:
    """Findings to be shown in place of those before."""

    findings: tuple[Judged, ...]


class NoPartError(RollerError):
    """A verdict was asked for where no part is known."""


class InspectStage(Stage[InspectParameters]):
    """Inspects part after part.

    A part ends when no points come for a while, on request, when the source starts again, or when
    the scan, after a pause, comes back to the same place; the next point begins another.

    Parameters
    ----------
    settings : InspectParameters
        Recipe and name of the parts.
    recipe : Recipe, optional
        In place of the one that the settings name.
    """

    node, part = "inspect", "findings"
    model = InspectParameters
    inputs = (outputs.SURFACE_POINTS, outputs.CONTACT, outputs.WRENCH)
    outputs = (outputs.FINDINGS, outputs.FINDING_MARKERS, outputs.DEVIATION)
    most_waiting = 5000
    patient_services = frozenset({"start", "finish"})

    def __init__(self, settings: InspectParameters, recipe: Recipe | None = None) -> None:
        super().__init__(settings)
        if recipe is None:
            recipe = load_recipe(Path(settings.recipe).expanduser() if settings.recipe else None)
        self.recipe = recipe
        self._reference = load_reference(recipe)
        self._number = self._points = 0
        self._part_points, self._revisits = PartPoints(), Revisits(settings.idle_flush_s)
        self._verdict, self._verdict_given = "", True
        self._last_ns = 0
        self._inspector: SurfaceInspector | None = None
        self._begin()

    def warm_up(self) -> None:
        """Load what finding and measuring takes: a third of a second."""
        x, y = np.meshgrid(np.arange(0.0, 0.024, 1e-4), np.arange(0.0, 0.008, 1e-4))
        dent = -2e-4 * (np.hypot(x - 6e-3, y - 4e-3) < 1e-3)
        points = np.stack([x, y, dent], axis=-1).reshape(-1, 3)
        sure = np.ones(len(points), np.float32)
        inspector = SurfaceInspector(self.recipe.settings, SelfReference())
        inspector.add(Patch(points, points[:, 2].astype(np.float32), sure, 2e-5 * sure))
        inspector.finish()

    def services(self) -> Mapping[str, Callable[[], str]]:
        """See `Stage`."""
        return {"start": self.start, "finish": self.finish}

    def start(self) -> str:
        """Finish what there is and begin a part."""
        self._finish()
        self._begin()
        return f"{self._name} begins with the next points"

    def finish(self) -> str:
        """Finish the part and say its verdict; once also of one that ended by itself.

        Raises
        ------
        NoPartError
            If there is none.
        """
        if self._inspector is not None:
            self._finish()
        elif self._verdict_given:
            before = f"; before: {self._verdict}" if self._verdict else ""
            raise NoPartError(f"{self._name}: no points yet{before}")
        self._verdict_given = True
        return self._verdict

    def take_camera(self, camera: Camera) -> None:
        """Nothing: points need none."""

    def take_output(self, output: Output) -> None:
        """Take points of the surface, or what is wrong with the scan."""
        if isinstance(output.data, ScanFault):
            self._faults.take_fault(output.t_ns, output.data.text)
            return
        cloud: Cloud = output.data
        if output.t_ns < self._last_ns - _RESTART_S * 1e9:
            self._finish()
        patch = self._part_points.take(cloud)
        if len(patch) and self._revisits.again(patch.points, output.t_ns):
            self._finish()
            patch = self._part_points.take(cloud)
            self._revisits.again(patch.points, output.t_ns)
        self._last_ns = output.t_ns
        if not len(patch):
            return
        if self._inspector is None:
            known = {"findings.cell": self.settings.uncertainty}
            self._inspector = SurfaceInspector(self.recipe.settings.changed(known), self._reference)
        self._points += len(patch)
        self._faults.passed(output.t_ns)
        self._give(self._inspector.add(patch))

    def take_force(self, t_ns: int, force_n: float) -> None:
        """Take the robot's force of a moment, N."""
        if told := self._faults.take_force(t_ns, force_n):
            self._waiting.append(Result(None, notice=told))

    def health(self) -> tuple[int, str]:
        """See `Stage`."""
        if self._inspector is None:
            return OK, self._verdict or "waiting for points"
        if self._faults.now:
            return ERROR, self._faults.now
        return OK, f"{self._name}: inspecting"

    def rated(self) -> Mapping[str, float]:
        """See `Stage`."""
        return {"point_rate_per_s": self._points}

    def counts(self) -> Mapping[str, object]:
        """See `Stage`."""
        known = self._judgement
        return {
            "part": self._name,
            "parts": self._number,
            "points": self._points,
            "left_out_points": self._part_points.left_out,
            "findings": len(known.findings) if known is not None else 0,
            "measured": round(known.coverage.measured, 4) if known is not None else "",
            "unmeasured": round(known.coverage.unmeasured, 4) if known is not None else "",
            "verdict": known.verdict if known is not None else "",
        }

    def _begin(self) -> None:
        self._inspector = None
        self._part_points.begin()
        self._revisits.begin()
        self._faults = ScanFaults(self.recipe.force_n)
        self._revision, self._seen = 0, -1
        self._cells = np.zeros(4, np.int64)
        self._judgement: Judgement | None = None
        self._judged: dict[Finding, tuple[Judged, ...]] = {}
        self._waiting: list[Result] = []

    def _results(self, flush: bool) -> Iterator[Result]:
        waiting, self._waiting = self._waiting, []
        yield from waiting
        if flush and self._inspector is not None:
            yield self._conclude(self._inspector)

    def _give(self, pieces: list[Piece]) -> None:
        """Put out strips that were passed, and the list of findings if it changed."""
        assert self._inspector is not None
        outs = self._deviations(pieces)
        for piece in pieces:
            self._cells += np.bincount(piece.height_map.state.ravel(), minlength=4)
        if pieces or self._inspector.revision != self._seen:
            self._seen = self._inspector.revision
            judged = self._judge(self._inspector.findings)
            sure = any(j.verdict == "nonconform" and j.finding.final for j in judged)
            verdict: Verdict = "nonconform" if sure else "inconclusive"
            so_far = Judgement(verdict, "not finished", judged, self._scanned())
            outs += self._list(so_far, finished=False)
        if outs:
            self._waiting.append(Result(None, tuple(outs)))

    def _judge(self, findings: Iterable[Finding]) -> tuple[Judged, ...]:
        """Findings by the recipe: those that are final are judged once."""
        known = self._judged
        self._judged = {
            f: known[f] if f in known else judge_findings(self.recipe, (f,)) for f in findings
        }
        return tuple(chain.from_iterable(self._judged.values()))

    def _conclude(self, inspector: SurfaceInspector) -> Result:
        """Finish the part; the next point begins another."""
        found = inspector.finish()
        self._part_points.left_out += found.left_out
        coverage, lacking = coverage_of_area(self.recipe, found)
        judgement = judge(
            self.recipe, found.findings, coverage, found.faults,
            measure_all(self.recipe, found.height_map, self.settings.uncertainty),
            self._faults.lines(), lacking,
        )  # fmt: skip
        if judgement.verdict == "conform":
            looks = (off_reference, damaged_all_over, goes_on_in_gap)
            if off := next(filter(None, (look(self.recipe, found) for look in looks)), ""):
                judgement = replace(judgement, verdict="inconclusive", reason=off)
        self._verdict_given = False
        self._verdict = f"{self._name}: {judgement.verdict}: {judgement.reason}"
        outs = self._deviations(found.last) + self._list(judgement, finished=True)
        inspected = Inspected(self._name, found, judgement)
        self._number += 1
        self._begin()
        self._judgement = judgement
        return Result(inspected, tuple(outs))

    @property
    def _name(self) -> str:
        """Of the part that is inspected, or of the next."""
        given, number = self.settings.part, self._number + 1
        return given if given and number == 1 else f"{given or 'part'} {number}"

    def _scanned(self) -> Coverage:
        """Coverage of the strips so far; where the scan came twice they count twice."""
        total = int(self._cells.sum() - self._cells[OUTSIDE])
        measured, continued = (self._cells[k] / max(total, 1) for k in (MEASURED, CONTINUED))
        area_m2 = total * self.recipe.grid_m**2
        return Coverage(
            float(measured), float(continued), float(1 - measured - continued), area_m2, 0.0
        )

    def _list(self, judgement: Judgement, finished: bool) -> list[Output]:
        self._judgement = judgement
        self._revision += 1
        data = FindingList(self._revision, finished, self._name, judgement)
        return [
            self._output(outputs.FINDINGS, data),
            self._output(outputs.FINDING_MARKERS, FindingMarkers(judgement.findings)),
        ]

    def _deviations(self, pieces: Iterable[Piece]) -> list[Output]:
        return [self._output(outputs.DEVIATION, deviation_cloud(piece)) for piece in pieces]

    def _output(self, topic: str, data: object) -> Output:
        return Output(topic, self._last_ns, self.settings.base_frame, data)


def deviation_cloud(piece: Piece) -> Cloud:
    """Cells of a piece whose height is known, with deviation, its uncertainty and state."""
    grid = piece.height_map
    row, column = np.nonzero(grid.known & np.isfinite(piece.deviation_m))
    height = grid.height_m[row, column]
    columns = np.empty((len(row), len(DEVIATION_FIELDS)), np.float32)
    columns[:, :3] = grid.in_base(grid.x_m[column], grid.y_m[row], height)
    columns[:, 3] = piece.deviation_m[row, column]
    columns[:, 4], columns[:, 5] = grid.sigma_m[row, column], grid.state[row, column]
    return Cloud(columns, DEVIATION_FIELDS)
