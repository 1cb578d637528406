"""Package husky_drivers: What talks to hardware: EtherCAT drives (CiA 402) and the VN-200."""

from setuptools import find_packages, setup

package = "husky_drivers"

setup(
    name=package,
    version="0.1.0",
    description="What talks to hardware: EtherCAT drives (CiA 402) and the VN-200.",
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
            "drive_bridge = husky_drivers.nodes.drive_bridge:main",
            "t265_driver = husky_drivers.nodes.t265_driver:main",
            "vn200_driver = husky_drivers.nodes.vn200_driver:main",
        ],
    },
)
