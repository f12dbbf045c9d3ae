"""Installs roller_inspect."""

from setuptools import find_packages, setup

NAME = "roller_inspect"

setup(
    name=NAME,
    version="0.1.0",
    description="From events and poses to surface, text and files; replay",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, NAME + ".*"]),
    package_data={"": ["py.typed", "*.yaml", "*.json", "*.txt", "*.css"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
        ("share/" + NAME, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "inspect_node = roller_inspect.nodes:inspect",
        ],
        "roller.commands": [
            "batch = roller_inspect.commands.batch",
            "inspect = roller_inspect.commands.inspect",
            "replay = roller_inspect.commands.replay",
        ],
    },
)
