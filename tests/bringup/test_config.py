"""The files in config/ say what the settings models say."""

import importlib.util
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from roller_core.parameter_files import node_name, parameter_file, read_parameters
from roller_core.settings import Settings
from roller_inspect.pipeline import PipelineSettings

ROOT = Path(__file__).resolve().parents[2]


def write_config() -> object:
    """The script that writes the files."""
    spec = importlib.util.spec_from_file_location("write_config", ROOT / "scripts/write_config.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FILES = write_config().FILES  # type: ignore[attr-defined]


@pytest.mark.parametrize("node", FILES)
def test_files_are_in_step_with_the_models(node: str) -> None:
    text = (ROOT / "config" / f"{node}.yaml").read_text()
    assert text == parameter_file({node: FILES[node]}), "run scripts/write_config.py"


@pytest.mark.parametrize("node", FILES)
def test_every_parameter_is_described_and_valid(node: str) -> None:
    model = FILES[node]
    check_descriptions(model, node)
    values = read_parameters(ROOT / "config" / f"{node}.yaml", node)
    assert model.create(values) == model.create({})


def check_descriptions(model: type[Settings], where: str) -> None:
    for name, field in model.model_fields.items():
        group = field.annotation
        if isinstance(group, type) and issubclass(group, Settings):
            assert group.__doc__, f"{where}.{name} has no description"
            check_descriptions(group, f"{where}.{name}")
        else:
            assert field.description, f"{where}.{name} has no description"


def test_a_process_that_stands_still_for_half_a_minute_is_not_given_up() -> None:
    """Fast DDS 3.2 doesn't always find one again that it gave up."""
    root = ElementTree.parse(ROOT / "config" / "fastdds.xml").getroot()
    kind = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
    (lease,) = (item.find(f"{kind}sec") for item in root.iter(f"{kind}leaseDuration"))
    assert lease is not None
    assert int(lease.text or 0) >= 2 * 30


def test_all_defaults_load_for_a_replay() -> None:
    for name in ("emvs", "stitcher", "surface", "braille", "slider_depth"):
        PipelineSettings.load(ROOT / "config" / f"{name}.yaml")


def test_every_config_file_is_a_parameter_file() -> None:
    for path in (ROOT / "config").glob("*.yaml"):
        data = yaml.safe_load(path.read_text()) or {}
        for node in map(node_name, data):
            assert isinstance(read_parameters(path, node), dict)
