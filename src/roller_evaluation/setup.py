"""Installs roller_evaluation."""

from setuptools import find_packages, setup

NAME = "roller_evaluation"

setup(
    name=NAME,
    version="0.1.0",
    description="The paper's experiments and speed against error, measured on the virtual cell",
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
            "bench = roller_evaluation.commands.bench",
            "evaluate = roller_evaluation.commands.evaluate",
        ],
    },
)
