"""Installs roller_sim."""

from setuptools import find_packages, setup

NAME = "roller_sim"

setup(
    name=NAME,
    version="0.1.0",
    description="The virtual cell: a simulated roller, camera and robot, with its ROS 2 node",
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
            "virtual_cell_node = roller_sim.nodes:virtual_cell",
        ],
        "roller.commands": [
            "simulate = roller_sim.commands.simulate",
        ],
    },
)
