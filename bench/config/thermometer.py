"""Certificate of a thermometer, that of a named reading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, model_validator

from bench.config.dcc import with_certificate
from bench.config.devices import Calibration
from drivers.certificates.corrections import TemperatureTable
from drivers.schema.fields import InUnit, Ratio, StrictModel


class ThermometerUncertainty(StrictModel):
    """Expanded uncertainty: an offset, a gain error on the temperature in °C, and the change of the offset in a run."""

    offset: Annotated[float, InUnit("°C", at_least=0)] = Field(0.0, description="the same at every temperature")
    gain: Annotated[Ratio, InUnit("", at_least=0)] = Field(0.0, description="of the temperature in °C, such as 0.2 %")
    drift: Annotated[float, InUnit("°C", at_least=0)] | None = Field(
        None, description="change of the offset from the beginning to the end of a run; default: a fifth of the offset"
    )


class _Corrections(StrictModel):
    """Corrections of a thermometer under the key that they have in its block."""

    corrections: TemperatureTable = ()


class ThermometerCalibration(Calibration):
    """Calibration certificate of a thermometer."""

    U: ThermometerUncertainty = ThermometerUncertainty()
    corrections: TemperatureTable = Field((), description="rows, by rising temperature")

    @model_validator(mode="wrap")
    @classmethod
    def _from_its_certificate(cls, data: Any, handler: ModelWrapValidatorHandler[Any], info: ValidationInfo) -> Any:
        """Take the values of the certificate that the block names."""
        if not isinstance(data, Mapping) or "dcc" not in data:
            return handler(with_certificate(data, ThermometerUncertainty, _Corrections, None, info))
        rows = {"corrections": data["corrections"]} if "corrections" in data else {}
        found = with_certificate({**data, "corrections": rows}, ThermometerUncertainty, _Corrections, None, info)
        return handler({**found, "corrections": found["corrections"].get("corrections", ())})
