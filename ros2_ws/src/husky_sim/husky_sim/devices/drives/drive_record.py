"""State of a simulated drive: one record, in the drive's own units (counts, counts/s, A, s)."""

import numpy as np

DRIVE = np.dtype(
    [
        # EtherCAT slave
        ("al_status", "i4"),  # AlState, with AL_ERROR
        ("al_status_code", "i4"),
        ("watchdog", "f8"),  # process data watchdog [s]
        ("watchdog_left", "f8"),  # [s]
        ("silent", "i4"),  # frames pass by
        ("away", "i4"),  # frames do not reach it: silent, or behind a break of the line
        # CiA 402 machine
        ("state", "i4"),
        ("mode", "i4"),  # mode of operation display
        ("controlword", "i4"),  # of the last frame
        ("starting", "f8"),  # self-test that is left [s]
        ("slowing", "i4"),  # a slow-down or a stand at its end
        ("slow_end", "i4"),  # state after the slow-down
        ("halted", "i4"),
        ("error_code", "i4"),
        ("emergency", "i4"),  # an emergency message waits to be fetched
        ("quick_stop_option", "i4"),
        ("shutdown_option", "i4"),
        ("disable_option", "i4"),
        ("halt_option", "i4"),
        ("fault_option", "i4"),
        ("abort_option", "i4"),
        # injected
        ("sto", "i4"),  # an STO input is low
        ("sto_state", "i4"),  # state that STO leaves an enabled drive in
        ("cut", "i4"),  # the cable behind it is cut
        ("unpowered", "i4"),
        ("disturbed", "i4"),  # the next enabled tick falls to switch on disabled
        ("injected_fault", "i4"),  # code that stands until it is cleared
        # motor
        ("position", "f8"),
        ("velocity", "f8"),
        ("current", "f8"),
        ("bus_voltage", "f8"),
        # targets and demand
        ("target_position", "f8"),
        ("target_velocity", "f8"),
        ("target_current", "f8"),
        ("current_offset", "f8"),
        ("max_torque", "f8"),  # current limit from 0x6072 [A]
        ("demand_velocity", "f8"),  # of a slow-down
        ("slow_deceleration", "f8"),
        # parameters
        ("deceleration", "f8"),
        ("quick_stop_deceleration", "f8"),
        ("following_window", "f8"),
        ("following_timeout", "f8"),
        ("following_time", "f8"),
        ("position_gain", "f8"),  # [1/s]
        ("velocity_gain", "f8"),  # [A s/count]
        ("rated_current", "f8"),  # continuous
        ("peak_ratio", "f8"),  # peak over rated, 0x6073
        ("peak_duration", "f8"),
        ("mean_current", "f8"),  # state of the current limiter's filter
        ("limited", "i4"),  # limited to the rated current
        ("undervoltage", "f8"),
        ("overvoltage", "f8"),
    ],
    align=True,
)
"""A slave on the bus, its CiA 402 machine, its motor, targets and parameters."""
