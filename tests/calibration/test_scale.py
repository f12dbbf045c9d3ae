"""Scale from caliper readings."""

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_calibration.scale import ScaleError, check_scale, scale_of

OPENINGS = [2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0]


def test_scale_is_the_mean_of_the_readings() -> None:
    pixels = np.array(OPENINGS) / 0.0422 + [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.0, -0.1]
    found = scale_of(OPENINGS, pixels)
    assert found.mm_per_px == pytest.approx(np.mean(OPENINGS / pixels))
    assert found.readings == 8
    assert 0 < found.standard_error_mm_per_px < found.deviation_mm_per_px < found.spread * 0.0422


@pytest.mark.parametrize(
    ("readings", "pixels", "says"),
    [
        ([2.0, 3.0], [47.0], "2 readings in mm and 1 in pixels"),
        ([2.0], [47.0], "1 reading"),
        ([2.0, 0.0], [47.0, 47.0], "reading 2"),
        ([2.0, float("nan")], [47.0, 47.0], "reading 2"),
        ([2.0, 3.0], [47.2, 85.0], "reading 1 .* is 20% off the others .* read it again"),
        ([2.0, 2.0, 3.0, 3.0], [47.4, 47.4, 71.1, 47.4], "reading 4 .* read it again"),
    ],
)
def test_nonsense_is_no_scale(readings: list[float], pixels: list[float], says: str) -> None:
    with pytest.raises(ScaleError, match=says):
        scale_of(readings, pixels)


def test_scale_and_camera_must_agree() -> None:
    assert check_scale(0.0422, 0.045, 1066.0) == pytest.approx(0.0422 * 1066 / 45 - 1)
    for wrong in (0.05, -1.0, float("nan")):
        with pytest.raises(ScaleError):
            check_scale(wrong, 0.045, 1066.0)


def test_caliper_gives_the_scale(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", "scale", "--readings-mm", "2,2,3,3,4,4,5,5", "--pixels"]
    assert main([*words, "47.2,47.6,71,71.3,94.9,94.6,118.3,118.7"]) == 0
    assert "0.04219 mm/px" in capsys.readouterr().out
    for pixels, says in (
        ("47", "8 readings in mm and 1"),
        ("47,x", "expected numbers"),
        ("47,,47", "expected numbers"),
    ):
        assert main([*words, pixels]) == 1
        assert says in capsys.readouterr().err
    words[3] = "0.002,0.002,0.003,0.003"
    assert main([*words, "47.2,47.6,71,71.3"]) == 1
    assert "reading 1 is 0.002, expected 0.1 to 100 mm" in capsys.readouterr().err
