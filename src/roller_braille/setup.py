"""Installs roller_braille."""

from setuptools import find_packages, setup

NAME = "roller_braille"

setup(
    name=NAME,
    version="0.1.0",
    description="Reading Braille from images of warped events, with its ROS 2 node",
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
            "braille_node = roller_braille.nodes:braille",
        ],
    },
)
