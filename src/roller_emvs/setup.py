"""Installs roller_emvs."""

from setuptools import find_packages, setup

NAME = "roller_emvs"

setup(
    name=NAME,
    version="0.1.0",
    description="Depth from events (EMVS) and the stitched surface, with their ROS 2 nodes",
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
            "emvs_node = roller_emvs.nodes:emvs",
            "stitcher_node = roller_emvs.nodes:stitcher",
            "surface_node = roller_emvs.nodes:surface",
        ],
    },
)
