"""Installs roller_recording."""

from setuptools import find_packages, setup

NAME = "roller_recording"

setup(
    name=NAME,
    version="0.1.0",
    description="Reading and writing recordings, with the recorder and player nodes",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, NAME + ".*"]),
    package_data={"": ["py.typed", "*.yaml", "*.json", "*.txt"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
        ("share/" + NAME, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "player_node = roller_recording.nodes:player",
            "recorder_node = roller_recording.nodes:recorder",
        ],
        "roller.commands": [
            "record = roller_recording.commands.record",
            "info = roller_recording.commands.info",
        ],
    },
)
