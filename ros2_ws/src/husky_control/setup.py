"""Package husky_control: What decides: modes, gaits, estimation, inclines, flight, planning."""

from setuptools import find_packages, setup

package = "husky_control"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "low_level_controller = husky_control.nodes.low_level_controller:main",
            "planner = husky_control.nodes.planner:main",
        ],
    },
)
