"""What the pages say can be followed: links, anchors, command lines, modules."""

import argparse
import re
import shlex
from pathlib import Path

import pytest

from roller_bringup import cli

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("src/*/README.md"))]


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    plain = (re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", head).strip().lower() for head in heads)
    return {re.sub(r"[^\w\- ]", "", head).replace(" ", "-") for head in plain}


def commands_on(page: Path) -> list[str]:
    """Command lines in blocks, and those in running text that name an option."""
    text = page.read_text().replace("\\\n", " ")
    blocks = re.findall(r"^```\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    lines += [line for line in re.findall(r"`(\./roller [^`\n]*)`", text) if " --" in line]
    found = [line.partition("./roller ")[2] for line in lines if line.startswith("./roller ")]
    return [line for line in found if "--help" not in line]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if link.startswith("http"):
            continue
        name, _, anchor = link.partition("#")
        place = page.parent / name if name else page
        assert place.exists(), link
        assert not anchor or anchor in anchors(place), link


def test_command_lines_parse(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    subparsers = parser.add_subparsers()
    modules = [cli.importlib.import_module(name) for name in cli.find_commands().values()]
    for module in modules:
        module.add_parser(subparsers)
    count = 0
    for page in PAGES:
        for line in commands_on(page):
            words = shlex.split(line, comments=True)
            for module in modules:
                words = getattr(module, "rewritten", list)(words)
            try:
                parser.parse_args(words)
            except SystemExit:
                pytest.fail(f"{named(page)}: {line}: {capsys.readouterr().err.splitlines()[-1]}")
            count += 1
    assert count > 50


@pytest.mark.parametrize("package", sorted(ROOT.glob("src/roller_*")), ids=lambda p: p.name)
def test_a_package_names_its_modules(package: Path) -> None:
    """In its page's table: a module, or a folder of them; which are private isn't said."""
    rows = re.findall(r"^\| (`.*?) \|", (package / "README.md").read_text(), re.MULTILINE)
    says = {name.rstrip("/") for row in rows for name in re.findall(r"`([^`]+)`", row)}
    source = package / package.name
    if package.name != "roller_msgs":
        there = {path.stem for path in source.rglob("*") if "__pycache__" not in path.parts}
        assert {s.split("/")[-1] for s in says if "*" not in s} <= there
    for path in sorted(source.rglob("*.py")):
        module = path.relative_to(source).with_suffix("")
        if path.name.startswith("_") or path.name.endswith("_settings.py"):
            continue
        folders = {str(folder) for folder in module.parents}
        assert module.name in {s.split("/")[-1] for s in says} or folders & says, module
