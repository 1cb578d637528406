"""Package husky_sim: The world on the far side of the wires: MuJoCo plant, drives, IMU emulator."""

from setuptools import find_packages, setup

package = "husky_sim"

setup(
    name=package,
    version="0.1.0",
    description="The world on the far side of the wires: MuJoCo plant, drives, IMU emulator.",
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
            "plant = husky_sim.nodes.plant:main",
        ],
        "husky_drivers.bus": [
            "sim = husky_sim.segment:SimulatedSegment",
        ],
    },
)
