"""A thermal chamber whose controller a profile describes."""

from __future__ import annotations

from drivers.description import Setup
from drivers.dialects.modbus_chamber.controller import ProfiledController
from drivers.dialects.modbus_chamber.description import ModbusChamberOptions
from drivers.errors import CannotConnect
from drivers.kinds.chamber.description import ChamberLimits, ChamberOptions, ChamberSafe
from drivers.kinds.chamber.driver import Chamber


class ModbusChamber(Chamber):
    """A ThermalChamber that ramps by itself, or whose set point goes in steps, as its profile says."""

    def __init__(self, setup: Setup[ModbusChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        options, profile = setup.options, setup.options.profile.content
        if profile is None:
            raise CannotConnect(
                setup.name, f"the profile {options.profile.path} of its controller is gone",
                remedy="Put the file back beside the bench file.",
            )  # fmt: skip
        how: ChamberOptions = options
        if profile.ramp is not None:
            how = ChamberOptions.model_construct(
                **{name: getattr(options, name) for name in ChamberOptions.model_fields}
            )
        super().__init__(setup.name, ProfiledController(setup, profile), setup.limits, setup.safe, how)
