"""Package husky_experiments: Experiments through the graph: sessions, metrics, figures, video."""

from setuptools import find_packages, setup

package = "husky_experiments"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed", "campaign/page.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
)
