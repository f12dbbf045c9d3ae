"""The recipe: what of a part is inspected, against what, and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from roller_core.digests import data_digest
from roller_core.settings import Settings
from roller_core.transforms import F64
from roller_inspect.findings import Limits
from roller_inspect.references import Form
from roller_inspect.surface_inspector import InspectionSettings

from .decision import Rule
from .measure import ALONE, ALONG, Measure
from .regions import FARTHEST_M, Region
from .tolerance import DEFAULT_TOLERANCE, Tolerance, check_discrimination

SCHEMA = "roller-recipe/1"
Kind = Literal["self", "nominal", "golden", "cad"]
#: How each is given.
_REFERENCES = {
    "self": "self",
    "nominal": "nominal[:FORM]",
    "golden": "golden:DIR",
    "cad": "cad:FILE",
}
#: The paper's three forces, N. It gives none in newtons: these are what a press of 0.4, 1.1 and
#: 2 mm takes on a part 20 mm wide (line contact, radius 47 mm, E* 0.9 MPa), about.
FORCES_N = {"light": (2.0, 20.0), "medium": (20.0, 40.0), "full": (40.0, 100.0)}


class Plate(Settings):
    """Where the part lies in base; regions of frame `plate` are counted from there."""

    origin_m: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="Origin in base.")
    yaw_rad: float = Field(
        0.0,
        ge=-2 * math.pi,
        le=2 * math.pi,
        description="Its x axis against that of base, about z.",
    )

    @model_validator(mode="after")
    def _check(self) -> Plate:
        if max(map(abs, self.origin_m)) > FARTHEST_M:
            raise ValueError(f"origin_m is over {FARTHEST_M:g} m away; recipes are in metres")
        return self

    @property
    def base_from_plate(self) -> F64:
        """4×4."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        out = np.eye(4)
        out[:2, :2] = [[c, -s], [s, c]]
        out[:3, 3] = self.origin_m
        return out


class Reference(Settings):
    """What the surface is held against."""

    kind: Kind = Field(
        "self",
        description="self: the scan's own background; nominal: a form fitted to it; golden: good "
        "parts that were taught; cad: a model.",
    )
    form: Form = Field(
        "plane",
        description="Form of nominal: none (the robot's nominal surface), plane, cylinder, "
        "polynomial2 to polynomial4.",
    )
    path: str = Field("", description="Folder of golden, file of cad; from the recipe's folder.")

    @model_validator(mode="before")
    @classmethod
    def _short(cls, values: Any) -> Any:
        """`golden:DIR` and `cad:FILE`, `nominal:cylinder` stand for the whole."""
        if isinstance(values, (Mapping, Reference)):
            return values
        kind, _, rest = str(values).partition(":")
        if kind not in get_args(Kind):
            raise ValueError(f"is not one of {', '.join(_REFERENCES.values())}")
        if kind == "nominal" and rest:
            return {"kind": kind, "form": rest}
        return {"kind": kind, "path": rest}

    @model_validator(mode="after")
    def _check(self) -> Reference:
        needs = self.kind in ("golden", "cad")
        if needs != bool(self.path):
            raise ValueError(f"it is given as {_REFERENCES[self.kind]}")
        return self

    def __str__(self) -> str:
        return f"{self.kind}:{self.form if self.kind == 'nominal' else self.path}".rstrip(":")


class Recipe(Settings):
    """A recipe; without a file, this."""

    model_config = ConfigDict(populate_by_name=True)

    schema_: str = Field(SCHEMA, alias="schema", description="Kind and version of the file.")
    name: str = Field("default", description="What it is called in reports.")
    frame: Literal["base", "plate"] = Field("base", description="Frame of all coordinates here.")
    plate: Plate = Plate.create({})
    reference: Reference = Reference.create({})
    grid_m: float = Field(0.1e-3, ge=20e-6, le=2e-3, description="Spacing of the height map.")
    regions: dict[str, Region] = Field({}, description="Regions by name.")
    inspect: tuple[str, ...] = Field(
        (), description="Regions to inspect; empty: all that the roller passed."
    )
    exclude: tuple[str, ...] = Field((), description="Regions that are left out.")
    least_coverage: float = Field(
        0.9,
        ge=0,
        le=1,
        description="Share of the area to inspect that must be measured or continued; below it "
        "the part is unmeasured.",
    )
    edge_exclusion_m: float = Field(
        1e-3, ge=0, le=0.1, description="Left out along the border of the scan and of the part."
    )
    limits: Limits = Limits.create({})
    tolerances: tuple[Tolerance, ...] = Field((), description="By region and kind.")
    lines: dict[str, tuple[tuple[float, float], tuple[float, float]]] = Field(
        {}, description="Lines by name, for profiles: begin x, y and end x, y."
    )
    measures: tuple[Measure, ...] = Field((), description="Named figures, with limits.")
    force_n: tuple[float, float] | None = Field(
        None,
        description="Force that the roller is to press with: least and most, N, or light, medium "
        "or full; none: it isn't watched.",
    )
    decision: Rule = Field(
        "iso_14253_1",
        description="iso_14253_1: a figure conforms where it does so with all of its uncertainty; "
        "simple_acceptance: the figure alone counts.",
    )

    @field_validator("force_n", mode="before")
    @classmethod
    def _named_force(cls, value: Any) -> Any:
        if isinstance(value, str) and value not in FORCES_N:
            raise ValueError(f"'{value}' is not one of {', '.join(FORCES_N)}, nor two forces in N")
        return FORCES_N[value] if isinstance(value, str) else value

    @model_validator(mode="after")
    def _check(self) -> Recipe:
        if self.schema_ != SCHEMA:
            raise ValueError(f"'schema' is {self.schema_!r}; {SCHEMA} is read")
        if self.frame == "base" and self.plate != Plate.create({}):
            raise ValueError("'plate' is of no use while 'frame' is base; set frame: plate")
        if self.force_n is not None and not 0 <= self.force_n[0] < self.force_n[1]:
            raise ValueError("'force_n' is the least and the most force, N")
        for name, ends in self.lines.items():
            if ends[0] == ends[1] or np.abs(ends).max() > FARTHEST_M:
                raise ValueError(
                    f"'lines.{name}' begins where it ends, or goes over {FARTHEST_M:g} m; recipes "
                    "are in metres"
                )
        names = [m.name for m in self.measures]
        if double := next((name for name in names if names.count(name) > 1), ""):
            raise ValueError(f"two 'measures' are called '{double}'")
        named = [("inspect", name) for name in self.inspect]
        named += [("exclude", name) for name in self.exclude]
        named += [(f"tolerances.{i}.region", t.region) for i, t in enumerate(self.tolerances)]
        named += [(f"measures.{i}.datum", m.datum) for i, m in enumerate(self.measures)]
        for i, m in enumerate(self.measures):
            if m.of in self.lines and m.tool in ALONG:
                continue
            if m.tool == "width":
                there = ", ".join(self.lines) or "none"
                raise ValueError(f"'measures.{i}.of' is '{m.of}'; {m.tool} is of a line ({there})")
            named.append((f"measures.{i}.of", m.of))
            if not m.datum and m.tool not in ALONE:
                raise ValueError(f"'measures.{i}': {m.tool} of a region needs a 'datum'")
        for where, name in named:
            if name and name not in self.regions:
                there = ", ".join(self.regions) or "none"
                raise ValueError(f"'{where}' names '{name}', which is not there (regions: {there})")
        for i, m in enumerate(self.measures):
            along = m.of in self.lines
            outline = np.array(self.lines[m.of]) if along else self.regions[m.of].outline()
            m.check_limits(f"measures.{i}", outline)
        check_discrimination(self.tolerances, self.limits)
        return self

    @property
    def base_from_recipe(self) -> F64:
        """The recipe's frame in base, 4×4."""
        return self.plate.base_from_plate if self.frame == "plate" else np.eye(4)

    @property
    def settings(self) -> InspectionSettings:
        """What map and search take of it."""
        search = {"limits": self.limits, "edge_exclusion_m": self.edge_exclusion_m}
        return InspectionSettings.create(
            {"height_map": {"grid_m": self.grid_m}, "findings": search}, self.name
        )

    def tolerance(self, kind: str, regions: tuple[str, ...]) -> Tolerance:
        """What holds for a finding of a kind that lies in some regions."""
        for entry in self.tolerances:
            if entry.kind in ("any", kind) and (not entry.region or entry.region in regions):
                return entry
        return DEFAULT_TOLERANCE

    @property
    def depth_tolerance_m(self) -> float:
        """Depth that a finding of any kind may have anywhere, for pictures."""
        depth = self.tolerance("", ()).depth_m
        return depth or DEFAULT_TOLERANCE.depth_m or 0.0

    def in_force(self) -> dict[str, Any]:
        """All of it as reports have it, with the tolerance that always comes last."""
        last = DEFAULT_TOLERANCE
        own = self.tolerances if last in self.tolerances else (*self.tolerances, last)
        return self.model_copy(update={"tolerances": own}).model_dump(mode="json", by_alias=True)

    def sha256(self) -> str:
        """Tells recipes apart, whatever their files look like."""
        return data_digest(self.model_dump(mode="json", by_alias=True))
