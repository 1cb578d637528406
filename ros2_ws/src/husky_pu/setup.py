"""Package husky_pu: Propulsion unit: companion's bridge, simulated Pixhawk, radio."""

from setuptools import find_packages, setup

package = "husky_pu"

setup(
    name=package,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package: ["py.typed", "mavlink/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "flight_controller = husky_pu.nodes.flight_controller:main",
            "pixhawk_bridge = husky_pu.nodes.pixhawk_bridge:main",
            "rc_transmitter = husky_pu.nodes.rc_transmitter:main",
        ],
    },
)
