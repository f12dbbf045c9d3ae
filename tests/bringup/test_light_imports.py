"""Nodes and the command start without the libraries that only some of their work needs."""

import subprocess
import sys
from importlib.metadata import entry_points

import pytest

#: Each takes a second or more to load.
HEAVY = ("open3d", "matplotlib", "dash")
SCRIPTS = [
    entry
    for entry in entry_points(group="console_scripts")
    if entry.module.startswith("roller_") and entry.name.endswith("_node")
]
NODES = {f"{entry.module.split('.')[0]}.{entry.name}" for entry in SCRIPTS}


def test_nodes_and_the_command_load_no_heavy_library() -> None:
    assert len(NODES) >= 8
    code = (
        "import importlib, sys\n"
        "for name in sys.argv[1:]:\n"
        "    importlib.import_module(name)\n"
        f"    found = [m for m in {HEAVY} if m in sys.modules]\n"
        "    assert not found, f'{name} loads {found}'\n"
    )
    words = [sys.executable, "-c", code, "roller_bringup.cli", *sorted(NODES)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]


def test_entry_points_of_nodes_load_next_to_nothing() -> None:
    """From then on an interrupt ends them without a traceback."""
    code = (
        "import sys\n"
        "from importlib import import_module\n"
        "for name in sys.argv[1:]:\n"
        "    module, function = name.split(':')\n"
        "    assert callable(getattr(import_module(module), function))\n"
        "assert not {'rclpy', 'numpy', 'pydantic'} & sys.modules.keys()\n"
    )
    words = [sys.executable, "-c", code, *sorted(entry.value for entry in SCRIPTS)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]


@pytest.mark.parametrize(
    "warmed",
    [
        "from roller_braille.warp import warm_up; warm_up()",
        "from roller_emvs.depth_stage import DepthStage as S; S(S.model.create({})).warm_up()",
        "from roller_emvs.depth_stage import DepthStage as S; "
        "S(S.model.create({'method': 'bma'})).warm_up()",
        "from roller_emvs.surface_stage import SurfaceStage as S; S(S.model.create({})).warm_up()",
    ],
)
def test_kernels_from_the_cache_load_nothing_that_only_compiling_needs(warmed: str) -> None:
    code = f"import sys\n{warmed}\nprint('scipy.linalg' in sys.modules)\n"
    said = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)  # the first may compile
    ]
    assert said[-1].stdout == "False\n"


def test_a_live_page_loads_no_image_library() -> None:
    """It is to stay small beside the nodes, and OpenCV takes 20 MB."""
    code = (
        "import sys, roller_bringup.view.server, roller_bringup.view.graph\n"
        "found = [m for m in ('cv2', 'pydantic', 'scipy', 'numba') if m in sys.modules]\n"
        "assert not found, found\n"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]
