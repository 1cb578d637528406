"""Section `bus_servo` of a robot whose joints are servos on a serial bus, each number in range.

SI units and radians except the temperature; sources of the values stand in the parameter file.
"""

from dataclasses import dataclass
from typing import Annotated

from husky_description.parameters import choice, count, number

MODEL_NUMBERS = {
    "XM430-W350": 1020,
    "XM430-W210": 1030,
    "XM540-W270": 1120,
    "XM540-W150": 1130,
}
"""Models of one control table, and the number by which each names itself (register 0)."""


@dataclass(frozen=True, eq=False)
class BusServoSection:
    """A servo with its own position control, twelve of which hang on one half-duplex bus.

    Attributes:
        model: the maker's name, one of `MODEL_NUMBERS`.
        model_number: by which it names itself on the bus (register 0).
        stall_torque: at the horn, at `voltage` [N m].
        stall_current: at `voltage` [A].
        no_load_speed: at `voltage` [rad/s].
        no_load_current: at `voltage` [A].
        voltage: of the supply at which these hold [V].
        gear_ratio: motor turns per turn of the horn [-].
        resolution: position counts per turn of the horn [-].
        backlash: of the gear at the horn, from one flank to the other [rad].
        armature: rotor and gear seen at the joint [kg m^2].
        baud_rate: of the bus [baud].
        cycle: period in which the bus reads and commands all servos [s].
        torque_limit: that the servo's current limit allows [N m].
        thermal_resistance: from the winding to the air [K/W].
        thermal_time: time constant of the winding's temperature [s].
        temperature_limit: at which the servo shuts down (register 31) [deg C].
        position_p: position P gain, in the servo's unit (register 84) [-].
        position_d: position D gain, in the servo's unit (register 80) [-].
    """

    model: Annotated[str, choice(*MODEL_NUMBERS)]
    model_number: Annotated[int, count(1, 65534)]
    stall_torque: Annotated[float, number(0.1, 20.0)]
    stall_current: Annotated[float, number(0.1, 20.0)]
    no_load_speed: Annotated[float, number(0.5, 30.0)]
    no_load_current: Annotated[float, number(0.0, 2.0)]
    voltage: Annotated[float, number(5.0, 30.0)]
    gear_ratio: Annotated[float, number(10.0, 1000.0)]
    resolution: Annotated[int, count(256, 65536)]
    backlash: Annotated[float, number(0.0, 0.05)]
    armature: Annotated[float, number(1e-5, 0.2)]
    baud_rate: Annotated[int, count(9600, 4_500_000)]
    cycle: Annotated[float, number(0.002, 0.1)]
    torque_limit: Annotated[float, number(0.1, 20.0)]
    thermal_resistance: Annotated[float, number(0.1, 100.0)]
    thermal_time: Annotated[float, number(1.0, 10000.0)]
    temperature_limit: Annotated[float, number(40.0, 100.0)]
    position_p: Annotated[int, count(0, 16383)]
    position_d: Annotated[int, count(0, 16383)]
