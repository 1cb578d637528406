"""Package husky_description: What the robot is: numbers, URDF, MuJoCo model, looks."""

from glob import glob

from setuptools import find_packages, setup

package = "husky_description"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/config", glob("config/*.yaml")),
        (f"share/{package}/urdf", glob("urdf/*.xacro")),
    ],
    zip_safe=False,
)
