"""Installs roller_bringup, with the launch and configuration files of the workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "roller_bringup"
HERE = Path(__file__).parent


def shared_files(folder: str) -> list[str]:
    """List the files of one folder; `launch` and `config` are links to the workspace's own."""
    found = (HERE / folder).glob("*")
    return sorted(str(path.relative_to(HERE)) for path in found if path.is_file())


setup(
    name=NAME,
    version="0.1.0",
    description="Launch files, RViz, the roller command, demonstration and doctor",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, NAME + ".*"]),
    package_data={"": ["py.typed", "*.yaml", "*.json", "*.txt"], NAME + ".view": ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
        ("share/" + NAME, ["package.xml"]),
        ("share/" + NAME + "/launch", shared_files("launch")),
        ("share/" + NAME + "/config", shared_files("config")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "roller = roller_bringup.cli:main",
        ],
        "roller.commands": [
            "up = roller_bringup.commands.up",
            "demo = roller_bringup.commands.demo",
            "doctor = roller_bringup.commands.doctor",
            "view = roller_bringup.commands.view",
        ],
    },
)
