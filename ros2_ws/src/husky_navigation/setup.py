"""Package husky_navigation: Map of the ground, the robot in it, and the cheapest way over it."""

from setuptools import find_packages, setup

package = "husky_navigation"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed", "planning/travel_costs.csv"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "elevation_mapper = husky_navigation.nodes.elevation_mapper:main",
            "localizer = husky_navigation.nodes.localizer:main",
            "navigator = husky_navigation.nodes.navigator:main",
        ],
    },
)
