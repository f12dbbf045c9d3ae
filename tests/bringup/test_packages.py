"""What a package imports is what its package.xml names, and the reverse."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON_PACKAGES = sorted(
    path.parent
    for folder in ("src", "underlay")
    for path in (ROOT / folder).glob("*/package.xml")
    if (path.parent / "setup.py").exists()
)
MESSAGE_PACKAGES = sorted(
    path.parent
    for folder in ("src", "underlay")
    for path in (ROOT / folder).glob("*/package.xml")
    if not (path.parent / "setup.py").exists()
)
#: Modules whose package has another name with rosdep.
ROSDEP = {
    "cv2": "python3-opencv",
    "joblib": "python3-joblib",
    "PIL": "python3-pil",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "transforms3d": "python3-transforms3d-pip",
    "usb": "python3-usb",
    "yaml": "python3-yaml",
}
#: Modules that rosdep has no name for, or one too old, and their names in requirements.in.
PIP_ONLY = {
    "aedat": "aedat",
    "annotated_types": "pydantic",
    "mcap": "mcap",
    "numba": "numba",
    "open3d": "open3d-cpu",
    "pydantic": "pydantic",
    "rich": "rich",
    "rosbags": "rosbags",
    "rtde_control": "ur-rtde",
    "rtde_receive": "ur-rtde",
    "starlette": "starlette",
    "uvicorn": "uvicorn",
    "zstandard": "zstandard",
}
#: Asked for and not imported: `entry_points` and editable installs need it, also when offline.
UNSEEN = {"setuptools"}
#: What `ros2 launch` reads our launch files with.
LAUNCH = {"launch_ros", "launch_xml", "ros2launch"}
#: What is the same in every package, and named where there is something to say of it.
UNNAMED = {"commands", "errors"}
#: Imported where it is there, and never needed.
OPTIONAL = {"argcomplete", "distributed", "h5py", "hdf5plugin", "louis", "rerun", "weasyprint"}


def imports_of(folder: Path) -> set[str]:
    """Top-level modules that a package imports, without its own and Python's."""

    def names(tree: ast.AST) -> Iterator[str]:
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                yield str(node.module)

    found = {
        name.split(".")[0]
        for path in (folder / folder.name).rglob("*.py")
        for name in names(ast.parse(path.read_text()))
    }
    return found - {folder.name} - sys.stdlib_module_names - OPTIONAL


def dependencies(folder: Path, *kinds: str) -> set[str]:
    """Names of the dependencies of some kinds in package.xml."""
    tree = ElementTree.parse(folder / "package.xml")
    return {str(entry.text) for kind in kinds for entry in tree.iter(kind)}


@pytest.mark.parametrize("folder", PYTHON_PACKAGES, ids=lambda path: path.name)
def test_package_xml_names_what_is_imported(folder: Path) -> None:
    imported = {ROSDEP.get(name, name) for name in imports_of(folder) - set(PIP_ONLY)}
    declared = dependencies(folder, "depend")
    lacking, idle = sorted(imported - declared), sorted(declared - imported)
    assert not lacking, f"{folder.name}/package.xml: add <depend> for {lacking}"
    assert not idle, f"{folder.name}/package.xml: nothing imports {idle}"
    # Started or loaded by name alone: packages of ours, and what reads launch files.
    started = dependencies(folder, "exec_depend")
    ours = {path.name for path in (*PYTHON_PACKAGES, *MESSAGE_PACKAGES)}
    assert started <= (ours | LAUNCH) - imported
    assert dependencies(folder, "test_depend") == {"python3-pytest"}


@pytest.mark.parametrize("folder", MESSAGE_PACKAGES, ids=lambda path: path.name)
def test_package_xml_names_the_messages_that_messages_hold(folder: Path) -> None:
    files = [path for kind in ("msg", "srv", "action") for path in folder.glob(f"*/*.{kind}")]
    used = {
        name
        for path in files
        for name in re.findall(r"^([a-z]\w*)/\w+", path.read_text(), re.MULTILINE)
    }
    cmake = (folder / "CMakeLists.txt").read_text()
    found = set(re.findall(r"^find_package\((\w+)", cmake, re.MULTILINE))
    used -= {folder.name}
    assert used <= dependencies(folder, "depend", "build_depend")
    assert dependencies(folder, "depend") <= used | {"action_msgs"}
    assert used <= found


def test_requirements_name_what_is_imported_and_nothing_else() -> None:
    lines = (ROOT / "requirements.in").read_text().splitlines()
    asked = {re.split(r"[<>=; ]", line)[0] for line in lines if not line.startswith("#")} - UNSEEN
    pip = {"cv2": "opencv-contrib-python-headless", "PIL": "pillow"}
    pip |= {"usb": "pyusb", "yaml": "pyyaml"}
    imported = {name for folder in PYTHON_PACKAGES for name in imports_of(folder)}
    needed = {PIP_ONLY.get(m, pip.get(m, m)) for m in imported & {*PIP_ONLY, *ROSDEP}}
    assert not asked - needed, "requirements.in asks for what nothing imports"
    assert not needed - asked, "requirements.in lacks what is imported"
    unknown = {n for n in imported if n not in {*PIP_ONLY, *ROSDEP} and not is_ros(n)}
    assert not unknown, "neither in ROSDEP nor in PIP_ONLY"


@pytest.mark.parametrize(
    "folder", [path for path in PYTHON_PACKAGES if path.parent.name == "src"], ids=lambda p: p.name
)
def test_a_packages_page_names_its_modules(folder: Path) -> None:
    cells = [line.split("|")[1] for line in (folder / "README.md").read_text().splitlines()
             if line.startswith("| `")]  # fmt: skip
    named = {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}
    known = {part for name in named for part in name.strip("/").split("/")}
    source = folder / folder.name
    own = {path.stem for path in source.iterdir() if path.suffix == ".py" or is_package(path)}
    assert not {name for name in own if not name.startswith("_")} - UNNAMED - known
    there = {path.stem for path in source.rglob("*")}
    gone = {name for name in known if not any(c in name for c in "…*") and name not in there}
    assert not gone, "modules that aren't there"


def is_package(path: Path) -> bool:
    return (path / "__init__.py").exists()


def is_ros(name: str) -> bool:
    """Tell a package of ROS or of ours by its name."""
    return (
        name.startswith(("roller_", "ament_", "rcl"))
        or name.endswith(("_msgs", "_srvs"))
        or (name in {"builtin_interfaces", "tf_transformations"})
    )


@pytest.mark.parametrize("folder", PYTHON_PACKAGES, ids=lambda path: path.name)
def test_setup_py_says_what_package_xml_says(folder: Path) -> None:
    tree = ElementTree.parse(folder / "package.xml")
    setup = (folder / "setup.py").read_text()
    assert f'NAME = "{folder.name}"' in setup
    assert tree.findtext("name") == folder.name
    for field in ("version", "description", "license"):
        assert f'{field}="{tree.findtext(field)}"' in setup, field
