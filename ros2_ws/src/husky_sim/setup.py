"""Package husky_sim: Simulated world: MuJoCo plant, propulsion, emulated devices."""

from setuptools import find_packages, setup

package = "husky_sim"

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
            "drive_segment = husky_sim.nodes.drive_segment:main",
            "plant = husky_sim.nodes.plant:main",
        ],
        "husky_drivers.bus": [
            "sim = husky_sim.devices.drives.segment:SimulatedSegment",
        ],
        "husky_drivers.pacer": [
            "sim = husky_sim.nodes.drive_pacer:PlantPacer",
            "soem = husky_sim.nodes.drive_pacer:FramePacer",
        ],
    },
)
