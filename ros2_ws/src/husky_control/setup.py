"""Package husky_control: what decides."""

from setuptools import find_packages, setup

package = "husky_control"

setup(
    name=package,
    version="0.1.0",
    description="What decides: kinematics, gaits, estimator, safety, modes, controller.",
    license="Apache-2.0",
    maintainer="Husky maintainers",
    maintainer_email="maintainers@husky-carbon.org",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "low_level_controller = husky_control.nodes.low_level_controller:main",
            "planner = husky_control.nodes.planner:main",
        ],
    },
)
