"""A part that was not in good contact, or not pressed as asked, is never conform."""

import math

import pytest

from roller_core.outputs import CONTACT, Output, ScanFault
from roller_core.stage import ERROR, OK
from roller_inspect.inspect_stage import InspectParameters, InspectStage
from roller_inspect.recipe import Recipe
from roller_inspect.report.document import Scan, inspection_document

from .analytic_surface import flat, scan
from .inspecting import PLANE, clouds, finished


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("slipping", "slipping: the image moves at 60% of the robot's speed (and 1 times more)"),
        (
            "slips to the end",
            "slipping: the image moves at 60% of the robot's speed (and 2 times more)",
        ),
        ("hard", "pressed too hard for 0.41 s, up to 41.0 N; the recipe asks for 5 to 30 N"),
        ("light", "pressed too lightly for 0.41 s, down to 1.0 N; the recipe asks for 5 to 30 N"),
        ("unknown", "the force is not known for 0.41 s; the recipe asks for 5 to 30 N"),
        ("none", "no force came; the recipe asks for 5 to 30 N"),
        ("lost", "7% of the event packets were lost: 20 of 300"),
        ("ended", "no events came over the last 40 mm of the way: the camera, or its recording"),
        ("silent in between", ""),
        ("before and after", ""),
        ("", ""),
    ],
)
def test_a_part_that_was_not_in_good_contact_is_never_conform(what: str, said: str) -> None:
    stage = InspectStage(InspectParameters.create({}), Recipe.create(PLANE | {"force_n": [5, 30]}))
    outputs = list(clouds(scan(flat)))
    first, last = outputs[0].t_ns, outputs[-1].t_ns
    bad_n = {"hard": 41.0, "light": 1.0, "unknown": math.nan}.get(what, 20.0)
    middle = (first + last) // 2
    for k, output in enumerate(outputs):
        stage.take_output(output)
        if k == 0 and what != "none":
            for t in range(first - 10**9, last + 10**9, 10**7):
                off = first < t < last and abs(t - middle) < 2.05e8
                out = what == "before and after" and not first < t < last
                stage.take_force(t, 99.0 if out else bad_n if off else 20.0)
            times = {
                "slipping": (first + 1, last - 1),
                "slips to the end": (last + 1, last + 2, last + 3),
                "before and after": (first - 1, last + 1),
            }
            for t in times.get(what, ()):
                fault = ScanFault("slipping: the image moves at 60% of the robot's speed")
                stage.take_output(Output(CONTACT, t, "", fault))
    if what == "lost":  # told when the scan is over, of a time within it
        stage.take_output(Output(CONTACT, middle, "", ScanFault(said, "data")))
    if what == "silent in between":  # points that follow show that events went on
        fault = ScanFault("no events came over the last 40 mm of the way", "data")
        stage.take_output(Output(CONTACT, middle, "", fault))
    if what == "ended":
        stage.take_output(Output(CONTACT, last + 10**8, "", ScanFault(said, "data")))
    part = finished(list(stage.results(flush=True)))
    judgement = part.judgement
    assert judgement.contact == ((said,) if said else ())
    assert judgement.verdict == ("inconclusive" if said else "conform")
    assert said in judgement.reason
    document = inspection_document(part, stage.recipe, Scan())
    assert document["contact"] == list(judgement.contact)


def test_force_that_is_soon_back_in_its_range_is_told_at_once_and_seen_in_the_status() -> None:
    stage = InspectStage(InspectParameters.create({}), Recipe.create(PLANE | {"force_n": [5, 30]}))
    (first, *_) = clouds(scan(flat))
    stage.take_output(first)
    list(stage.results())
    told, levels = [], []
    for k in range(500):  # a hundred a second; one sample too much, and a tenth of a second
        force_n = 41.0 if k == 50 or 100 <= k < 110 else 20.0
        stage.take_force(first.t_ns + k * 10**7, force_n)
        told += [(k, r.notice) for r in stage.results() if r.notice]
        levels.append(stage.health()[0])
    said = "pressed too hard: 41.0 N, the recipe asks for 5 to 30 N"
    assert told == [(102, said)]
    assert levels[:102] == [OK] * 102
    assert levels[102:250] == [ERROR] * 148  # statuses come once a second
    assert levels[-1] == OK
