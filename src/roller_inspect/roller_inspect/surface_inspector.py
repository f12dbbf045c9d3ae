"""Points of the surface in, height map and findings out: live, offline and in tests the same."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from pydantic import Field

from roller_core.settings import Settings
from roller_emvs.patch import Patch

from .findings.find import Search, search
from .findings.finder_settings import FindingSettings
from .findings.finding import Finding
from .findings.places import BORDER_M, cell_of, findings_beside, findings_inside, same_place
from .height_map.coverage import Coverage, coverage_of
from .height_map.height_map import OUTSIDE, Bools, HeightMap
from .height_map.join import join, join_size, window_of, without_run_in
from .height_map.map_settings import HeightMapSettings
from .height_map.mapper import HeightMapper
from .pieces import Found, Piece, Whole, part_of, within
from .references.reference import Alignment, Reference, ReferenceError

#: So many new strips are mapped and searched at once, the first and later: what each is searched
#: together with costs the less the more there are.
_FIRST_STRIPS, _STRIPS_AT_ONCE = 3, 6
#: What they are searched together with, m: findings are at most provisional on it; and so many
#: strips more where one goes on.
_CONTEXT_M, _MOST_OPEN = 8e-3, 4
#: Findings are final once the scan is this far beyond them, m.
_PASSED_M = 3e-3


class InspectionSettings(Settings):
    """Settings of map and search."""

    height_map: HeightMapSettings = Field(HeightMapSettings.create({}), description="The map.")
    findings: FindingSettings = Field(FindingSettings.create({}), description="The search.")


class SurfaceInspector:
    """Makes map and findings from patches as they come, in bounded memory.

    Parameters
    ----------
    settings : InspectionSettings
        Of map and search.
    reference : Reference
        What the surface is compared with.
    on_piece : callable, optional
        Takes each `Piece` of a scan that is too long for memory, in order and without overlap;
        and at the end the last one.

    Attributes
    ----------
    findings : tuple of Finding
        All so far: final ones, and provisional ones where the scan is now.
    revision : int
        Counts up whenever `findings` changed.
    """

    def __init__(
        self,
        settings: InspectionSettings,
        reference: Reference,
        on_piece: Callable[[Piece], None] | None = None,
    ) -> None:
        self.settings = settings
        self.reference = reference
        self.findings: tuple[Finding, ...] = ()
        self.revision = 0
        self._mapper = HeightMapper(settings.height_map)
        self._on_piece = on_piece
        self._passed: list[int] = []
        self._looked = False
        self._strips: dict[int, HeightMap] = {}
        #: Where findings are on them: they stay out of the reference's fit.
        self._masks: dict[int, Bools] = {}
        #: The last strip of the piece before, for what lies on the border.
        self._before: dict[int, HeightMap] = {}
        self._number = 0
        self._faults: dict[str, None] = {}
        #: Of pieces that are given up.
        self._gone: list[Finding] = []
        self._whole = Whole(settings.height_map.max_cells)
        self._worst: Alignment | None = None

    @property
    def left_out(self) -> int:
        """Points that are nowhere, or further from the others than any of a part."""
        return self._mapper.left_out

    def add(self, patch: Patch) -> list[Piece]:
        """Take points; those that can't be of the part are left out, counted.

        Returns
        -------
        list of Piece
            Strips that the scan has passed, each once (again where the scan came back to it);
            the last ones come with `finish`.
        """
        self._passed += self._mapper.add(patch)
        if len(self._passed) < (_STRIPS_AT_ONCE if self._looked else _FIRST_STRIPS):
            return []
        self._looked = True
        pieces = self._look_at(self._mapped())
        if (
            sum(strip.height_m.size for strip in self._strips.values())
            > self.settings.height_map.max_cells
        ):
            for run in self._together(self._cut()):
                self._conclude(run)
        return pieces

    def finish(self) -> Found:
        """The scan is over: everything, final."""
        self._passed += self._mapper.finish()
        last = self._look_at(self._mapped(), ended=True)
        for run in self._together(self._strips):
            self._conclude(run)
        trimmed = deviation = shares = None
        coverage = Coverage()
        if (whole := self._whole.piece) is not None:
            trimmed = without_run_in(whole.height_map)
            deviation = np.where(trimmed.state == OUTSIDE, np.nan, whole.deviation_m)
            if whole.shares is not None:
                cut = (trimmed.state == OUTSIDE) & (whole.height_map.state != OUTSIDE)
                shares = np.where(cut, np.float32(0), whole.shares)
            coverage = coverage_of(trimmed, shares=shares)
            self._gone = [f for f in self._gone if trimmed.state[cell_of(f, trimmed)] != OUTSIDE]
            last = within(last, trimmed)
        self._set(tuple(self._gone))
        return Found(
            trimmed, deviation, self.findings, self._worst, coverage, tuple(self._faults),
            tuple(last), shares, self.left_out,
        )  # fmt: skip

    def _mapped(self) -> list[int]:
        """Strips that were passed, mapped by now."""
        passed, self._passed = sorted(set(self._passed)), []
        self._strips.update(self._mapper.strips(passed))
        return passed

    def _search(
        self,
        height_map: HeightMap,
        final: bool,
        known: Iterable[Finding] = (),
        masked: Bools | None = None,
        figures: bool = True,
    ) -> Search | None:
        cells = [(*cell_of(f, height_map), f.depth_m) for f in known]
        try:
            return search(
                height_map, self.reference, self.settings.findings, cells, masked, figures
            )
        except ReferenceError as error:
            # A window that is still too small may say so; what is concluded must not.
            if final:
                self._faults.setdefault(str(error))
            return None

    def _look_at(self, strips: list[int], ended: bool = False) -> list[Piece]:
        """`_look`, where they lie together."""
        return [piece for run in self._together(strips) for piece in self._look(run, ended)]

    def _look(self, strips: list[int], ended: bool) -> list[Piece]:
        """Findings around new strips: provisional near them, final behind.

        Of a scan that has ended they come with the whole: here is only where they are.
        """
        around = round(_CONTEXT_M / self._mapper.length_m)
        low, high = min(strips) - around, max(strips) + around
        # What wasn't passed yet is seen whole.
        for first, last in (self._reach(f) for f in self.findings if not f.final):
            if last >= low and first <= high:
                low, high = max(min(low, first), low - _MOST_OPEN), max(high, last)
        near = [k for k in self._strips if low <= k <= high]
        window = join([self._strips[k] for k in near])
        # A crater is measured again, as what rises around it is told by it.
        passed = [f for f in self.findings if f.final and f.kind != "crater"]
        passed = findings_inside(passed, window)
        found = self._search(window, final=False, known=passed, figures=not ended)
        if found is None:
            return []
        for k in near:
            self._masks[k] = part_of(found.mask, window, self._strips[k])
        new = [self._strips[k] for k in strips]
        if not ended:
            self._take(found, new, window)
        deviation = found.comparison.deviation_m
        return [Piece(strip, part_of(deviation, window, strip)) for strip in new]

    def _take(self, found: Search, new: list[HeightMap], window: HeightMap) -> None:
        """Findings of a search in a window whose newest strips are some."""
        margin = round(_PASSED_M / window.step_m)
        at = [(s.x_m[[0, -1]] - window.x_m[0]) / window.step_m for s in new]
        ends = (
            min(first for first, _ in at) < margin,
            max(last for _, last in at) + 1 > window.shape[1] - margin,
        )
        fresh = []
        for finding, (first, last) in zip(found.findings, found.spans, strict=True):
            open_end = (ends[1] and last > window.shape[1] - margin) or (ends[0] and first < margin)
            fresh.append(replace(finding, final=not open_end))
        here = {f.id for f in findings_inside(self.findings, window)}
        kept = [f for f in self.findings if f.final or f.id not in here]
        final = findings_beside(fresh, [f for f in kept if f.final], window)
        fresh = [f for f in fresh if not any(same_place(f, f0) for f0 in final)]
        self._set(tuple([*kept, *self._numbered(fresh, window)]))

    def _reach(self, finding: Finding) -> tuple[int, int]:
        """First and last strip that a finding touches."""
        frame = self._mapper.frame
        x = (finding.outline_m - frame[:3, 3]) @ frame[:3, 0]
        length_m = self._mapper.length_m
        return int(np.floor(x.min() / length_m)), int(np.floor(x.max() / length_m))

    def _numbered(self, findings: list[Finding], window: HeightMap) -> list[Finding]:
        """Findings on a map that were reported before keep their number."""
        out, taken = [], set()
        known = findings_beside(findings, self.findings, window)
        for finding in findings:
            before = [f for f in known if f.id not in taken and same_place(finding, f)]
            if before:
                number = before[0].id
            else:
                self._number += 1
                number = self._number
            taken.add(number)
            out.append(replace(finding, id=number))
        return out

    def _set(self, findings: tuple[Finding, ...]) -> None:
        findings = tuple(sorted(findings, key=lambda f: f.id))
        if findings != self.findings:
            self.findings = findings
            self.revision += 1

    def _cut(self) -> list[int]:
        """Strips to conclude: all but what the newest findings may still need."""
        order = list(self._strips)
        # The scan may have come back to strips, and be in the middle of them.
        newest = set(order[-4:]) | self._mapper.under_way
        low, high = min(newest) - _MOST_OPEN, max(newest) + _MOST_OPEN
        keep = set(newest)
        for first, last in (self._reach(f) for f in self.findings if not f.final):
            # What lies where the scan began stays open: nothing is to come there.
            if last >= low and first <= high:
                keep |= set(range(first, last + 1))
        done = [k for k in order if k not in keep]
        return done or order[:-1]

    def _together(self, strips: Iterable[int]) -> list[list[int]]:
        """Strips in order, to be compared as one; far from each other, where they lie together.

        A map of all would span what lies between.
        """
        strips = sorted(strips)
        if not strips:
            return []
        most = self.settings.height_map.max_cells
        if join_size([self._strips[k] for k in strips]) <= most:
            return [strips]
        return _runs(strips)

    def _conclude(self, strips: list[int]) -> None:
        """Inspect strips as a whole and give them up."""
        whole = join([self._strips[k] for k in strips])
        # What lies on the border is seen whole together with the strips beside it.
        beside = {k + d for k in strips for d in (-1, 1) if k + d in self._strips}
        before = {k: m for k, m in self._before.items() if {k - 1, k + 1} & set(strips)}
        parts = before | {k: self._strips[k] for k in [*sorted(beside), *strips]}
        window = join(list(parts.values()))
        masked = np.zeros(window.shape, bool)
        for k in parts.keys() & self._masks.keys():
            masked[window_of(window, parts[k])] = self._masks[k]
        found = self._search(window, final=True, masked=masked)
        self._before = {k: self._strips[k] for k in strips[-1:]}
        for k in strips:
            del self._strips[k]
        kept = self._before.keys() | self._strips.keys()
        self._masks = {k: mask for k, mask in self._masks.items() if k in kept}
        self._mapper.forget(strips)
        deviation = np.full(whole.shape, np.nan, np.float32)
        if found is not None:
            deviation = part_of(found.comparison.deviation_m, window, whole)
            alignment = found.comparison.alignment
            if self._worst is None or not alignment.residual_m < self._worst.residual_m:
                self._worst = alignment
            # Seen from two pieces, a centre on the border may fall into neither.
            fresh = findings_inside(found.findings, whole, BORDER_M)
            known = findings_beside(fresh, self._gone, whole)
            fresh = [f for f in fresh if not any(same_place(f, g) for g in known)]
            self._gone += self._numbered(fresh, whole)
        gone = {f.id for f in (*self._gone, *findings_inside(self.findings, whole))}
        rest = [f for f in self.findings if f.id not in gone]
        self._set(tuple([*self._gone, *rest]))
        piece = Piece(whole, deviation)
        if self._on_piece is not None:
            self._on_piece(piece)
        self._whole.add(piece)


def _runs(strips: Iterable[int]) -> list[list[int]]:
    """Strips that lie together, of some in order."""
    runs: list[list[int]] = []
    for k in strips:
        if runs and k - runs[-1][-1] <= _MOST_OPEN:
            runs[-1].append(k)
        else:
            runs.append([k])
    return runs
