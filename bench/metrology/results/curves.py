"""Equations with known constants for the user of a unit, each with its validity range.

Every model has `id`, `uut` and `quantity`, and `to_json` for the results.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, cast

from bench.metrology.results.flag import Flag

if TYPE_CHECKING:  # imported for types only: models are shown where numpy is not loaded
    from bench.metrology.least_squares import Array, PolynomialFit


@dataclass(frozen=True, slots=True)
class TemperatureModel:
    """A polynomial of a quantity over temperature: in x = (T - centre) / scale, and in powers of T in °C."""

    id: str
    uut: str
    quantity: str
    unit: str
    centre: float
    scale: float
    coefficients: tuple[float, ...]
    u: tuple[float, ...] | None = None
    correlation: tuple[tuple[float, ...], ...] = ()
    powers_of_t: tuple[float, ...] = ()
    residual_sd: float | None = None
    dof: int = 0
    max_residual: float = 0.0
    valid_c: tuple[float, float] = field(kw_only=True)
    dwells_used: int = 0
    dwells_left_out: tuple[str, ...] = ()

    def at(self, temperature_c: Array) -> Array:
        """Values (n,) at temperatures (n,), beyond its range too."""
        from numpy.polynomial import polynomial

        values: Any = polynomial.polyval((temperature_c - self.centre) / self.scale, self.coefficients)
        return cast("Array", values)

    @classmethod
    def of_fit(
        cls, fit: PolynomialFit, *, id: str, uut: str, quantity: str, unit: str, used: int, left_out: tuple[str, ...]
    ) -> TemperatureModel:
        """Model from a fit over temperature, from `used` dwells or legs."""
        return cls(
            id=id,
            uut=uut,
            quantity=quantity,
            unit=unit,
            centre=fit.centre,
            scale=fit.scale,
            coefficients=tuple(fit.coefficients.tolist()),
            u=tuple(fit.u.tolist()) if fit.dof else None,
            correlation=tuple(tuple(row) for row in fit.correlation.tolist()),
            powers_of_t=tuple(fit.powers.tolist()),
            residual_sd=fit.residual_sd if fit.dof else None,
            dof=fit.dof,
            max_residual=fit.max_residual,
            valid_c=fit.valid,
            dwells_used=used,
            dwells_left_out=left_out,
        )

    def to_json(self) -> dict[str, Any]:
        """JSON content for the results."""
        content = _content(self, "sum of c[i] · x^i, x = (T - centre) / scale, T the indicated temperature in °C")
        return {"powers_of_T" if name == "powers_of_t" else name: value for name, value in content.items()}


@dataclass(frozen=True, slots=True)
class Constant:
    """A constant of an equation with its standard uncertainty; `u` None if unknown."""

    value: float
    unit: str
    u: float | None = None

    def to_json(self) -> dict[str, Any]:
        """JSON content of a constant as a curve over temperature, for a calibration file."""
        return {"form": "constant", **asdict(self)}


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation in words that a program can follow, with `clauses` on its symbols, and its constants.

    `correlation` is that of the constants in their order, empty if unknown. `valid` are the ranges of the inputs, by
    names with their unit: "temperature_c".
    """

    id: str
    uut: str
    quantity: str
    form: str
    constants: Mapping[str, Constant]
    valid: Mapping[str, tuple[float, float]]
    correlation: tuple[tuple[float, ...], ...] = ()
    clauses: tuple[Flag, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """JSON content for the results."""
        return {
            "id": self.id,
            "uut": self.uut,
            "quantity": self.quantity,
            "form": ", ".join((self.form, *map(str, self.clauses))),
            "constants": {name: asdict(each) for name, each in self.constants.items()},
            "correlation": [list(row) for row in self.correlation],
            "valid": {name: list(ends) for name, ends in self.valid.items()},
        }


@dataclass(frozen=True, slots=True)
class KnotModel:
    """A quantity over temperature by linear interpolation between knots, constant beyond them (equations 4.5)."""

    id: str
    uut: str
    quantity: str
    unit: str
    knots_c: tuple[float, ...]
    values: tuple[float, ...]
    u: tuple[float, ...]

    def to_json(self) -> dict[str, Any]:
        """JSON content for the results."""
        content = _content(self, "straight lines between the knots, the end values held beyond them")
        return {**content, "valid_c": [self.knots_c[0], self.knots_c[-1]]}


def _content(model: TemperatureModel | KnotModel, form: str) -> dict[str, Any]:
    """The fields of a model, with its form after its unit."""
    fields = asdict(model)
    title = {name: fields.pop(name) for name in ("id", "uut", "quantity", "unit")}
    return {**title, "form": form, **fields}


Model = TemperatureModel | Equation | KnotModel
