"""Package husky_runtime: What nodes stand on: graph, executor, lockstep, clocks, ports."""

from setuptools import find_packages, setup

package = "husky_runtime"

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
)
