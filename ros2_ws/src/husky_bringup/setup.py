"""Package husky_bringup: Launch and parameter files, recorder, teleoperation, gateway, console."""

from glob import glob

from setuptools import find_packages, setup

package = "husky_bringup"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed", "console/website/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/launch", ["launch/husky.launch.py"]),
        (f"share/{package}/config", glob("config/*.yaml")),
        (f"share/{package}/layouts", glob("layouts/*")),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "console = husky_bringup.nodes.console:main",
            "foxglove_gateway = husky_bringup.nodes.foxglove_gateway:main",
            "recorder = husky_bringup.nodes.recorder:main",
            "teleop = husky_bringup.nodes.teleop:main",
        ],
    },
)
