"""Installs roller_ros."""

from setuptools import find_packages, setup

NAME = "roller_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="What the nodes share: parameters, QoS, messages, poses from TF, diagnostics",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, NAME + ".*"]),
    package_data={"": ["py.typed", "*.yaml", "*.json", "*.txt"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
        ("share/" + NAME, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
)
