"""Package husky_drivers: Robot's side of the wires: drives (CiA 402), VN-200, T265, D435."""

from setuptools import find_packages, setup

package = "husky_drivers"

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
            "drive_bridge = husky_drivers.nodes.drive_bridge:main",
            "servo_bridge = husky_drivers.nodes.servo_bridge:main",
            "t265_driver = husky_drivers.nodes.t265_driver:main",
            "d435_driver = husky_drivers.nodes.d435_driver:main",
            "vn200_driver = husky_drivers.nodes.vn200_driver:main",
        ],
        "husky_drivers.bus": [
            "soem = husky_drivers.ethercat.soem_bus:SoemBus",
        ],
    },
)
