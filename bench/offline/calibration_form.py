"""Form of the channels of a calibration file: curves over temperature, linearity, response, force terms."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from bench.metrology.calibration.dynamic import DynamicBias
from bench.metrology.calibration.force_terms import ForceTerms, Sample
from bench.metrology.calibration.linearity import RELATIVE, Linearity
from bench.metrology.calibration.nominal_output import NominalOutput
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.calibration.second_order import NAMES
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel
from bench.offline.case_file import Tolerant
from drivers.schema.wording import telling

SAME_CURVE = 1e-9  # of the sum of the magnitudes of its terms
Known = Compensation | ResponseCompensation


class _Polynomial(Tolerant):
    unit: str
    centre: float
    scale: float = Field(gt=0)
    coefficients: tuple[float, ...] = Field(min_length=1)
    u: tuple[float, ...] | None = None
    valid_c: tuple[float, float]
    powers_of_t: tuple[float, ...] | None = Field(None, alias="powers_of_T")

    @model_validator(mode="after")
    def _is_one_curve(self) -> Self:
        """Check that both forms of a curve in the file agree; an edited one was not measured."""
        if not self.powers_of_t:
            return self
        at_c = np.linspace(self.centre - self.scale, self.centre + self.scale, 1 + len(self.coefficients))
        powers = np.polynomial.polynomial.polyval(at_c, self.powers_of_t)
        size = np.abs(self.powers_of_t) @ np.max(np.abs(at_c)) ** np.arange(len(self.powers_of_t))
        if not np.allclose(powers, self.curve().at(at_c), rtol=0, atol=SAME_CURVE * size):
            raise telling("coefficients and powers_of_T are not the same curve: the file was edited")
        return self

    def curve(self) -> TemperatureModel:
        return TemperatureModel(
            "", "", "", self.unit, self.centre, self.scale, self.coefficients, self.u, valid_c=self.valid_c
        )


class _Knots(Tolerant):
    unit: str
    knots_c: tuple[float, ...] = Field(min_length=1)
    values: tuple[float, ...] = Field(min_length=1)
    u: tuple[float, ...] = ()

    def curve(self) -> KnotModel:
        return KnotModel("", "", "", self.unit, self.knots_c, self.values, self.u)


class _Constant(Tolerant):
    unit: str
    value: float
    u: float | None = None

    def curve(self) -> Constant:
        return Constant(self.value, self.unit, self.u)


def _kind(raw: Any) -> str:
    """Kind of a curve, by a key that only this kind has."""
    keys = {"coefficients": "polynomial", "knots_c": "knots"} if isinstance(raw, dict) else {}
    return next((kind for key, kind in keys.items() if key in raw), "constant")


_Curve = Annotated[
    Annotated[_Polynomial, Tag("polynomial")] | Annotated[_Knots, Tag("knots")] | Annotated[_Constant, Tag("constant")],
    Discriminator(_kind),
]


class _Linearity(Tolerant):
    full_scale: float = Field(gt=0)
    scale_error: _Constant | None = None
    asymmetry: _Constant | None = None
    quadratic: _Constant | None = None
    cubic: _Constant | None = None
    valid: tuple[float, float]

    def linearity(self) -> Linearity:
        given = {name: each.value for name in RELATIVE if (each := getattr(self, name)) is not None}
        return Linearity(given, {}, (), self.full_scale, self.valid)


class _Response(Tolerant):
    K: _Constant
    f0: _Constant
    damping: _Constant
    delay: _Constant
    valid_hz: tuple[float, float]


class _Force(Tolerant):
    quadratic: _Constant
    cross: dict[str, _Constant] = Field(default_factory=dict)
    correlation: tuple[tuple[float, ...], ...] = ()
    bias_u_g: float = Field(0.0, ge=0)
    scale_u: float = Field(0.0, ge=0)
    valid_g: tuple[float, float]
    sample: Sample = ""
    step: float = Field(0.0, ge=0)

    def terms(self) -> ForceTerms:
        cross = {name: each.curve() for name, each in self.cross.items()}
        return ForceTerms(
            self.quadratic.curve(), self.valid_g, cross, self.correlation, self.bias_u_g, self.scale_u, self.sample,
            self.step,
        )  # fmt: skip


class _Nominal(Tolerant):
    at_c: float
    offset_u: tuple[float, ...]
    scale_u: tuple[float, ...]
    offset_beside_u: float = Field(0.0, ge=0)
    scale_beside_u: float = Field(0.0, ge=0)

    def output(self) -> NominalOutput:
        return NominalOutput(self.at_c, self.offset_u, self.scale_u, self.offset_beside_u, self.scale_beside_u)


class _Dynamic(Tolerant):
    bias: _Polynomial
    rate: _Constant
    fastest: float = Field(alias="fastest_C_per_min", gt=0)

    def dynamic(self) -> DynamicBias:
        return DynamicBias(self.bias.curve(), self.rate.curve(), self.fastest)


class ChannelForm(Tolerant):
    """An entry of a calibration file."""

    channel: str
    output: str
    value: str
    scale: _Curve
    offset: _Curve | None = None
    bias: _Curve | None = None
    linearity: _Linearity | None = None
    response: _Response | None = None
    force: _Force | None = None
    thermometer: str = ""
    nominal: _Nominal | None = None
    dynamic: _Dynamic | None = None

    @model_validator(mode="after")
    def _has_all_knots(self) -> Self:
        knots = len(self.scale.knots_c) if isinstance(self.scale, _Knots) else 0
        if self.nominal is not None and {len(self.nominal.offset_u), len(self.nominal.scale_u)} != {knots}:
            raise telling(f"nominal needs an offset_u and a scale_u for each of {knots} knots of scale")
        return self

    def compensation(self) -> Known:
        """Compensation of the channel."""
        scale = self.scale.curve()
        if self.response is not None and isinstance(scale, Constant):
            constants = {name: getattr(self.response, name).curve() for name in NAMES}
            valid_hz = self.response.valid_hz
            return ResponseCompensation(self.channel, self.output, self.value, scale, constants, valid_hz)
        offset, bias = (None if each is None else each.curve() for each in (self.offset, self.bias))
        linearity = None if self.linearity is None else self.linearity.linearity()
        force = None if self.force is None else self.force.terms()
        nominal = None if self.nominal is None else self.nominal.output()
        dynamic = None if self.dynamic is None else self.dynamic.dynamic()
        return Compensation(
            self.channel, self.output, self.value, scale, offset, bias, linearity,
            force=force, thermometer=self.thermometer, nominal=nominal, dynamic=dynamic,
        )  # fmt: skip
