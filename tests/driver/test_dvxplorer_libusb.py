"""The camera's model seen through the real libusb, by our driver and by the vendor's library."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from driver.emulation.camera_words import encode_words, in_order
from roller_core.events import EventArray

TESTS = Path(__file__).parents[1]
PACKAGES = "apt install umockdev gir1.2-umockdev-1.0 python3-gi"


def missing():
    """What keeps these tests from running here."""
    if sys.version_info[:2] != _debian_python():
        return f"Debian's gi is for Python {'.'.join(map(str, _debian_python() or ('?',)))}"
    code = (
        "import sys; sys.path.append('/usr/lib/python3/dist-packages'); import gi; "
        "gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
    )
    if subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode:
        return f"umockdev is not installed: {PACKAGES}"
    return "" if os.geteuid() == 0 else "needs to be root"


def _debian_python():
    found = sorted(Path("/usr/lib/python3/dist-packages/gi").glob("_gi.cpython-3*.so"))
    tags = [path.name.split("-")[1] for path in found]
    return (3, int(tags[0][1:])) if tags else None


@pytest.fixture(scope="module", autouse=True)
def _runs_here():
    reason = missing()
    if reason:
        pytest.skip(reason)


def scan():
    rng = np.random.default_rng(7)
    frames, each = 1000, 200
    pixels = np.concatenate([rng.choice(640 * 480, each, replace=False) for _ in range(frames)])
    # The vendor's library takes a frame at the very time of its reference for one out of order.
    t_us = np.repeat(1_000_003 + 200 * np.arange(frames), each)
    events = EventArray.from_arrays(
        pixels % 640, pixels // 640, t_us * 1000, rng.integers(0, 2, len(t_us))
    )
    return in_order(events)


def read(who, events, folder, count, **camera):
    words = folder / "words.u4"
    encode_words(events).tofile(words)
    output = folder / f"{who}.npz"
    client = [sys.executable, "-m", "driver.emulation.usb_clients", who, str(count), str(output)]
    paths = os.pathsep.join(filter(None, [str(TESTS), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [sys.executable, "-m", "driver.emulation.umockdev_host",
         json.dumps({"words": str(words), **camera}), *client],
        env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, timeout=90,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    data = np.load(output)
    got = EventArray(data["x"], data["y"], data["t_ns"], data["p"])
    size = words.stat().st_size
    print(f"{who}: {size / float(data['seconds']) / 1e6:.1f} MB/s")
    return got


def table(events):
    e = in_order(events)
    return np.stack([e.t_ns, e.x, e.y, e.p], axis=1)


@pytest.mark.parametrize("firmware", [8, 10])
def test_our_driver_reads_every_event(firmware, tmp_path):
    events = scan()
    got = read("ours", events, tmp_path, len(events), firmware=firmware)
    assert np.array_equal(table(got), table(events))


def test_the_vendors_library_reads_the_same(tmp_path):
    if importlib.util.find_spec("dv_processing") is None:
        pytest.skip("dv-processing is not installed")
    events = scan()
    # It hands out whole batches: the last ones don't come.
    count = len(events) * 8 // 10
    got = read("vendors", events, tmp_path, count, firmware=10, bytes_per_s=2e6)
    theirs, ours = table(got), table(events)
    shift = theirs[0, 0] - ours[0, 0]
    theirs[:, 0] -= shift
    assert len(theirs) >= count
    assert np.array_equal(theirs, ours[: len(theirs)])
