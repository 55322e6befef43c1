"""Sensors with the figures of their data sheets, of parts that a 20 g robot or its rig can have.

Each preset names its sheet; what the sheet does not say is zero here and named. Where it is to be
put, and delay and clock of the set-up at hand, come by `dataclasses.replace(preset, ...)`.
Neglected: what sheets say of temperature, supply and ageing.
"""

from __future__ import annotations

import math
from typing import Any

from patagium.errors import ParameterError, positive
from patagium.sensing.sensors.imu import Imu
from patagium.sensing.sensors.joints import Encoder, MotorCurrent
from patagium.sensing.sensors.load_cell import LoadCell
from patagium.sensing.sensors.motion_capture import MotionCapture

__all__ = ["as5600", "bmi270", "icm_42688_p", "ina226", "nano17", "prime_x_13"]

STANDARD_GRAVITY = 9.80665
"""What data sheets call g [m/s^2]."""

_DEGREE = math.pi / 180
_AT_16_G: dict[str, Any] = {
    "accelerometer_bias": 20e-3 * STANDARD_GRAVITY, "gyroscope_bias": 0.5 * _DEGREE,
    "accelerometer_step": STANDARD_GRAVITY / 2048, "gyroscope_step": _DEGREE / 16.4,
    "accelerometer_range": 16 * STANDARD_GRAVITY, "gyroscope_range": 2000 * _DEGREE,
}  # fmt: skip
"""Figures that inertial units at +-16 g and +-2000 deg/s have alike."""
_AS5600_NOISE = {2.2e-3: 0.015, 1.1e-3: 0.021, 0.55e-3: 0.030, 0.286e-3: 0.043}


def icm_42688_p(body: str, rate: float = 1000.0) -> Imu:
    """TDK InvenSense ICM-42688-P at +-16 g and +-2000 deg/s, 2.5 x 3 x 0.91 mm.

    Noise 65 (x, y) and 70 (z) ug/sqrt(Hz) and 2.8 mdeg/s/sqrt(Hz), zero-g output +-20 mg,
    zero-rate output +-0.5 deg/s, 2048 counts a g, 16.4 counts a deg/s. The sheet does not give
    the walk of the biases.

    Args:
        body: Body that carries it.
        rate: Samples a second, at most 32 kHz [Hz].

    Raises:
        ParameterError: If the rate is out of the part's range.

    References:
        TDK InvenSense, ICM-42688-P data sheet DS-000347.
    """
    g = STANDARD_GRAVITY
    return Imu(
        name="icm_42688_p",
        body=body,
        rate=_at_most(rate, 32000.0),
        accelerometer_density=(65e-6 * g, 65e-6 * g, 70e-6 * g),
        gyroscope_density=2.8e-3 * _DEGREE,
        **_AT_16_G,
    )


def bmi270(body: str, rate: float = 1600.0) -> Imu:
    """Bosch Sensortec BMI270 at +-16 g and +-2000 deg/s, 2.5 x 3 x 0.83 mm.

    Noise 160 ug/sqrt(Hz) and 7 mdeg/s/sqrt(Hz) (performance mode), zero-g offset +-20 mg,
    zero-rate offset +-0.5 deg/s, 16 bits. The sheet does not give the walk of the biases.

    Args:
        body: Body that carries it.
        rate: Samples a second, at most 1.6 kHz for the accelerometer [Hz].

    Raises:
        ParameterError: If the rate is out of the part's range.

    References:
        Bosch Sensortec, BMI270 data sheet BST-BMI270-DS000.
    """
    return Imu(
        name="bmi270",
        body=body,
        rate=_at_most(rate, 1600.0),
        accelerometer_density=160e-6 * STANDARD_GRAVITY,
        gyroscope_density=7e-3 * _DEGREE,
        **_AT_16_G,
    )


def as5600(
    joints: tuple[str, ...] = (), rate: float = 1000.0, settling: float = 0.286e-3
) -> Encoder:
    """ams AS5600 magnetic encoder: 12 bits a turn, noise by the setting of its filter.

    RMS noise 0.015, 0.021, 0.030 or 0.043 deg where it settles in 2.2, 1.1, 0.55 or 0.286 ms. The
    sheet's nonlinearity of +-1 deg with a well placed magnet is taken as calibrated away; the
    error of the zero depends on the mounting, the sheet does not give it. The filter itself is
    not modeled: its delay is for the user to state.

    Args:
        joints: Names of the coordinates; () for all actuated ones.
        rate: Samples a second, at most one in 150 us [Hz].
        settling: Of the filter [s].

    Raises:
        ParameterError: If rate or settling time are none of the part's.

    References:
        ams, AS5600 data sheet v1-06 (2018).
    """
    if settling not in _AS5600_NOISE:
        raise ParameterError("settling", f"one of {', '.join(map(str, _AS5600_NOISE))}", settling)
    return Encoder(
        name="as5600",
        joints=joints,
        rate=_at_most(rate, 1 / 150e-6),
        resolution=2 * math.pi / 4096,
        std=_AS5600_NOISE[settling] * _DEGREE,
    )


def nano17(body: str | None = None, rate: float = 1000.0) -> LoadCell:
    """ATI Nano17 six-axis load cell, calibration SI-12-0.12: for a rig, 9.1 g.

    Ranges 12 N (x, y), 17 N (z), 0.12 N m; resolution 1/320 N and 1/64 N mm; its resonance at
    7.2 kHz is far above what is sampled here. The sheet states the resolution of a typical
    system, not a noise; bias (tared) and cross-talk (part of each cell's own certificate, of
    1 to 1.75 % of the range with all else) are not given and zero here.

    Args:
        body: Body that carries it; None: it stands at the world's origin.
        rate: Samples a second [Hz].

    References:
        ATI Industrial Automation, F/T transducer manual 9620-05, Nano17.
    """
    return LoadCell(
        name="nano17",
        body=body,
        rate=rate,
        force_step=1 / 320,
        moment_step=1e-3 / 64,
        force_range=(12.0, 12.0, 17.0),
        moment_range=0.12,
    )


def prime_x_13(body: str, rate: float = 240.0) -> MotionCapture:
    """OptiTrack PrimeX 13 cameras: 240 frames a second, 4.2 ms late.

    Accuracy +-0.20 mm and +-0.5 deg; the sheet says neither how much of it is noise nor how
    often frames are lost: all of it is taken as the deviation of noise, and none are.

    Args:
        body: Body that carries the markers.
        rate: Frames a second, at most 240 at full resolution [Hz].

    Raises:
        ParameterError: If the rate is out of the part's range.

    References:
        OptiTrack, PrimeX 13 specifications.
    """
    return MotionCapture(
        name="prime_x_13",
        body=body,
        rate=_at_most(rate, 240.0),
        delay=4.2e-3,
        position_std=0.20e-3,
        attitude_std=0.5 * _DEGREE,
    )


def ina226(
    joints: tuple[str, ...] = (),
    *,
    torque_constant: float,
    gear_ratio: float = 1.0,
    shunt: float = 0.1,
    rate: float = 1000.0,
) -> MotorCurrent:
    """Texas Instruments INA226 across a shunt: 2.5 uV a count, offset +-2.5 uV, range 81.92 mV.

    Gain error 0.02 % (typical, as the offset). The sheet states no noise; one conversion
    takes 140 us. The torque constant is the motor's.

    Args:
        joints: Names of the coordinates; () for all actuated ones.
        torque_constant: Of the motor [N m/A].
        gear_ratio: Turns of the motor for one of the joint.
        shunt: Resistance [ohm].
        rate: Samples a second, at most one in 140 us [Hz].

    Raises:
        ParameterError: If a number is out of its range.

    References:
        Texas Instruments, INA226 data sheet SBOS547B.
    """
    positive("shunt", shunt)
    return MotorCurrent(
        name="ina226",
        joints=joints,
        rate=_at_most(rate, 1 / 140e-6),
        torque_constant=torque_constant,
        gear_ratio=gear_ratio,
        resolution=2.5e-6 / shunt,
        offset_std=2.5e-6 / shunt,
        torque_constant_std=0.2e-3,
        range=81.92e-3 / shunt,
    )


def _at_most(rate: float, largest: float) -> float:
    if rate > largest:
        raise ParameterError("rate", f"at most {largest:g} Hz, as the sheet has it", rate)
    return rate
