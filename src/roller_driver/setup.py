"""Installs roller_driver."""

from setuptools import find_packages, setup

NAME = "roller_driver"

setup(
    name=NAME,
    version="0.1.0",
    description="Drivers of the roller cell: event camera and UR10 poses, with their ROS 2 nodes",
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
        "roller.commands": [
            "motion = roller_driver.commands.motion",
        ],
        "console_scripts": [
            "event_camera_node = roller_driver.nodes:event_camera",
            "ur10_node = roller_driver.nodes:ur10",
        ],
    },
)
