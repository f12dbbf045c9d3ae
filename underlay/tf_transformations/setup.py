"""Installs tf_transformations."""

from setuptools import find_packages, setup

NAME = "tf_transformations"

setup(
    name=NAME,
    version="0.1.0",
    description="Rotations as quaternions (x, y, z, w) and 4x4 matrices, as in ROS distributions",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, NAME + ".*"]),
    package_data={"": ["py.typed", "*.yaml", "*.json", "*.txt"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + NAME]),
        ("share/" + NAME, ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy", "transforms3d"],
    zip_safe=True,
)
