"""A unit with one gyro in its place: its file, what its converter counts, and what the thermometer at it says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.fields import StrictModel
from simulators.attitude import to_unit
from simulators.dynamics import POINTS, Follower, look_at_s, mean_input
from simulators.faults import OPEN_C, FaultPlan
from simulators.gyro import GyroModel, GyroNoise, Vectors, draw_gyro
from simulators.unit_file import SupplyModel, ThermalModel, stream
from simulators.warmth import Thermometer

if TYPE_CHECKING:  # it is the world that makes it
    from simulators.settings import WorldSettings
    from simulators.world import World

Array = NDArray[np.float64]


class GyroFile(StrictModel):
    """One `config/uut/*.yaml` with a gyro instead of an accelerometer; its input axis is the x of its place."""

    schema_: Literal["itb-uut/1"] = Field(alias="schema")
    title: str
    gyro: GyroModel
    thermal: ThermalModel = ThermalModel()
    supply: SupplyModel = SupplyModel()


class SimulatedGyro:
    """One gyro in its place, between the world and the counter."""

    def __init__(self, place: str, file: GyroFile, index: int, settings: WorldSettings, world: World) -> None:
        self.place = place
        self.settings = settings.places[place]
        self.truth = draw_gyro(file.gyro, settings.seed, place, supply_a=file.supply.current)
        self.faults = FaultPlan(self.settings.faults, world.now)
        self._index, self._world = index, world
        self._noise = GyroNoise(self.truth, settings.seed, place)
        dynamics = self.truth.dynamics
        self._follower = Follower(dynamics) if dynamics is not None else None
        own = self.settings
        self._thermometer = Thermometer(
            settings.chamber.start_c, own.thermometer_offset_c, own.thermometer_gain, settings.thermometer_noise_c,
            stream(settings.seed, "noise", place, "thermometer"), own.thermometer_table,
        )  # fmt: skip
        self.powered_at_s: float | None = None

    @property
    def swings(self) -> bool:
        """Whether what it senses may turn round between two latches."""
        return self._follower is not None

    def charge_pulses(self, edges_s: Array) -> Array:
        """Pulses that are due in each interval between the consecutive times `edges_s`."""
        interval_s = np.diff(edges_s)
        if self.powered_at_s is None:
            return np.zeros_like(interval_s)
        look_s = look_at_s(edges_s, self.truth.delay_s)
        rate_dps, force_g = self._sensed(look_s.ravel())
        noise_dps = np.repeat(self._noise.mean_dps(interval_s), len(POINTS))
        temperature_c = self._world.thermal.sensor_c(self._index)
        sensed_pps = self.truth.output_pps(rate_dps, force_g, temperature_c, noise_dps).reshape(look_s.shape)
        if self.faults.active("dead"):
            return np.zeros_like(interval_s)
        output_pps = self._follower.mean(sensed_pps, interval_s) if self._follower else mean_input(sensed_pps)
        return np.asarray(self.truth.clipped_pps(output_pps) * interval_s)

    def _sensed(self, at_s: Array) -> tuple[Vectors, Vectors]:
        """Rate in °/s and specific force in g, along the input, the pendulous and the output axis."""
        to_axes = to_unit(self._world.mount, self.settings.mount_angle_deg)
        turning_dps = to_axes @ self._world.carried.rate_dps(at_s)
        force_g = to_axes @ self._world.carried.force_g(at_s, self.settings.arm_m)
        return (turning_dps[0], turning_dps[2], turning_dps[1]), (force_g[0], force_g[2], force_g[1])

    def power(self, since_s: float | None) -> None:
        """It has power since a time, or none."""
        self.powered_at_s = since_s

    def thermometer_c(self, at_s: Array) -> Array:
        """Readings of the thermometer at the unit at times since the last call, with its errors and noise."""
        thermal = self._world.thermal
        read_c = self._thermometer.readings_c(at_s, thermal.now_s, thermal.thermometer_c(self._index))
        return np.full_like(read_c, OPEN_C) if self.faults.active("open_thermometer") else read_c
