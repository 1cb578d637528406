"""Package husky_description: The robot's numbers, names, models and the names of its ROS graph."""

from glob import glob

from setuptools import find_packages, setup

package = "husky_description"

setup(
    name=package,
    version="0.1.0",
    description="The robot's numbers, names, models and the names of its ROS graph.",
    license="Apache-2.0",
    maintainer="Husky maintainers",
    maintainer_email="maintainers@husky-carbon.org",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/config", ["config/carbon.yaml"]),
        (f"share/{package}/urdf", glob("urdf/*.xacro")),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
    },
)
